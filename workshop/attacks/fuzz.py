"""Fuzzes every kind of file that the program reads by atheris (libFuzzer), and prints a Markdown row for each.

    python attacks/fuzz.py --minutes 10             all targets, in ten minutes
    python attacks/fuzz.py --cases 20000 npz gltf   a number of cases of two of them

A case is a finding if an exception other than ``InputError`` comes out of the reader or of the next step, if its error
is not one line with the file's name, if it takes more than ``MAX_CPU_S`` of processor time or more memory than
``BASE_MEMORY`` and ten times the file's unpacked size, or if the process dies or waits for ``MAX_WAIT_S``. An oracle
that shares no code with the reader (``fuzz_oracles``) judges the motion that is read: motion that differs from the
file's is a finding too. A target ends at its first finding, whose file libFuzzer stores in workshop/tests/fuzz_corpus,
for a test that reads it from then on. The exit status is 1 if there is a finding. Linux only.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import nullcontext
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "workshop" / "tests" / "fuzz_corpus"
NAMES = ("avatar", "fbxavatar", "landmarks", "lexicon", "gltf", "fbx", "recipes", "shards", "bundle", "npz", "smplx",
         "pickle", "array", "pose", "bvh", "signs", "roles", "written", "report", "pairs", "lines", "glosses",
         "face")  # fmt: skip
"""The targets, slowest first."""
MAX_CPU_S = 5.0
"""Processor time limit of a case, s."""
MAX_WAIT_S = 60
"""Wall-clock time limit of a case, s, whatever it waits for."""
BASE_MEMORY = 64 << 20
"""Memory that a case may take besides ten times the unpacked size of its file, bytes."""
_ADDRESS_SPACE = 8 << 30
_COUNTS = ("cases", "read and used", "judged by the oracle", "slowest, s", "memory, of what a case may take", "time, s")
"""What is counted of a target's cases, in this order; the time is processor time."""


def main() -> int:
    """Fuzzes the targets that the command line names; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(NAMES)}; default: all")
    parser.add_argument("--minutes", type=float, help="time in all")
    parser.add_argument("--cases", type=int, help="files of each target; default: 2,000 without --minutes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="targets at a time")
    parser.add_argument("--seeds", type=Path, help="folder of further files to start from")
    parser.add_argument(
        "--coverage", action="store_true", help="prefer files that reach new lines of code: fewer cases, most refused"
    )
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--flags", default="", help=argparse.SUPPRESS)
    options = parser.parse_args()
    names = options.targets or NAMES
    if options.child:
        further = [path.read_bytes() for path in sorted(options.seeds.iterdir())] if options.seeds else []
        return _run_child(names[0], options.child, options.flags.split(), further, options.coverage)
    if unknown := [name for name in names if name not in NAMES]:
        parser.error(f"no target {unknown[0]!r}, expected of {', '.join(NAMES)}")
    jobs = min(options.jobs, len(names))
    seconds = int(60.0 * options.minutes * jobs / len(names)) if options.minutes else 0
    n_cases = options.cases or (-1 if options.minutes else 2000)
    flags = [f"-max_total_time={seconds}", f"-runs={n_cases}", f"-seed={options.seed + 1}", f"-timeout={MAX_WAIT_S}"]
    flags += ["-rss_limit_mb=0", "-max_len=300000", "-len_control=0", "-keep_seed=1", "-mutate_depth=2", "-verbosity=0"]
    print(f"| target | {' | '.join(_COUNTS)} |\n|{' --- |' * (len(_COUNTS) + 1)}", flush=True)
    n_findings = 0
    with ThreadPoolExecutor(jobs) as pool:
        for running in as_completed([pool.submit(_fuzz, name, flags) for name in names]):
            row, finding = running.result()
            print(f"{row}\n{finding}".rstrip(), flush=True)
            n_findings += finding != ""
    return int(n_findings > 0)


def _fuzz(name: str, flags: list[str]) -> tuple[str, str]:
    """Returns a target's row, and the end of what its process said if it has a finding. ``flags``: of libFuzzer."""
    base = "/dev/shm" if Path("/dev/shm").is_dir() else None  # in memory: cases read many files
    path = os.pathsep.join([str(ROOT / "tests"), *filter(None, [os.environ.get("PYTHONPATH")])])  # for avatars.py
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=base) as folder:
        counts = np.memmap(Path(folder) / "counts", "f8", "w+", shape=len(_COUNTS))
        words = [word for word in sys.argv[1:] if word not in NAMES]
        command = [sys.executable, __file__, *words, "--child", folder, f"--flags={' '.join(flags)}", name]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": path}
        process = subprocess.run(command, capture_output=True, check=False, env=environment)
        cells = (f"{count:,.0f}" if number < 3 else f"{count:.2f}" for number, count in enumerate(counts))
        said = process.stderr.decode("utf-8", "replace")[-3000:] if process.returncode else ""
    return f"| {name} | {' | '.join(cells)} |", said


def _run_child(name: str, folder: Path, flags: list[str], further: list[bytes], coverage: bool) -> int:
    """Fuzzes a target in this process, which ends at a finding. ``further``: files to start from besides its own."""
    import atheris

    with atheris.instrument_imports(include=["signsplice"]) if coverage else nullcontext():
        from fuzz_targets import TARGETS
    from fuzz_trees import find_suffix, mutate_file

    target, counts = TARGETS[name], np.memmap(folder / "counts", "f8", "r+", shape=len(_COUNTS))
    for kind in ("files", "corpus"):
        (folder / kind).mkdir()
    seeds = [*target.seeds(), *further, *(path.read_bytes() for path in sorted((CORPUS / name).glob("*")))]
    for number, content in enumerate(seeds):
        (folder / "corpus" / str(number)).write_bytes(content)
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    start = time.process_time()

    def run_case(content: bytes) -> None:
        counts[0] += 1
        limit, case_start = BASE_MEMORY + 10 * target.unpacked(content), time.process_time()
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
        memory = _read_memory("VmRSS")
        loaded, was_used = target.exercise(content, folder / "files")
        seconds, fraction = time.process_time() - case_start, (_read_memory("VmHWM") - memory) / limit
        counts[1] += was_used
        counts[2] += target.judge(content, loaded)
        counts[3:] = max(counts[3], seconds), max(counts[4], fraction), time.process_time() - start
        assert seconds < MAX_CPU_S, f"{seconds:.1f} s of processor time"
        assert fraction < 1.0, f"{fraction * limit / 2**20:.0f} MiB for a file of {len(content)} bytes"

    def mutate_part(part: bytes) -> bytes:
        return bytes(atheris.Mutate(part, len(part) + 64))

    def mutate(content: bytes, max_size: int, seed: int) -> bytes:
        rng = random.Random(seed)
        content = content if rng.random() < 0.4 else rng.choice(seeds)  # most files that libFuzzer keeps are refused
        return mutate_file(content, find_suffix(content), rng, mutate_part)[:max_size]

    (CORPUS / name).mkdir(exist_ok=True)
    flags = [*flags, f"-artifact_prefix={CORPUS / name}/", str(folder / "corpus")]
    atheris.Setup([sys.argv[0], *flags], run_case, custom_mutator=mutate)
    atheris.Fuzz()
    return 0


def _read_memory(name: str) -> int:
    """Returns a field of the process's status, bytes."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition(name + ":")[2].split(maxsplit=1)[0]) << 10


if __name__ == "__main__":
    sys.exit(main())
