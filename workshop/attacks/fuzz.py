"""Fuzzes every kind of file that the program reads, and prints a Markdown row for each.

    python attacks/fuzz.py --minutes 10             all targets, in ten minutes
    python attacks/fuzz.py --cases 20000 npz gltf   an exact number of cases of two of them

A case is a finding if an exception other than ``InputError`` comes out of the reader or of the next step, if its error
is not one line with the file's name, if it takes more than ``MAX_CPU_S`` of processor time or more memory than
``BASE_MEMORY`` and ten times the file's unpacked size, or if the process dies. An oracle that shares no code with the
reader (``fuzz_oracles``) judges the motion that is read: motion that differs from the file's is a finding too. Its file
is then stored in workshop/tests/fuzz_corpus, for a test that reads it from then on. The exit status is 1 if there is a
finding.

Cases are mutations by a seeded generator, the same in each run, or (``--engine coverage``) chosen by atheris for the
lines of code that they reach. They run in a child process, which is restarted after a case that kills it. Linux only.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fuzz_targets import Target

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "workshop" / "tests" / "fuzz_corpus"
NAMES = ("avatar", "fbxavatar", "lexicon", "gltf", "fbx", "recipes", "shards", "bundle", "npz", "smplx", "bvh", "signs",
         "roles", "written", "report", "pairs", "lines", "glosses", "face")  # fmt: skip
"""The targets, slowest first."""
MAX_CPU_S = 5.0
"""Processor time limit of a case, s."""
MAX_WAIT_S = 60.0
"""Wall-clock time limit of a case, s, whatever it waits for."""
BASE_MEMORY = 64 << 20
"""Memory that a case may take besides ten times the unpacked size of its file, bytes."""
ADDRESS_SPACE = 8 << 30
MAX_STORED_FILE = 200_000
"""Size of the largest file that is stored in the corpus, bytes."""


@dataclass
class Tally:
    """Results of the cases of a target.

    name, engine: of the target, and what chose the cases.
    n_cases: number of files.
    n_read: number of files read and used without an error.
    n_judged: number of files judged by the oracle; None if there is no oracle.
    slowest_s: processor time of the slowest case.
    memory: greatest fraction of its memory limit that a case took.
    findings: (kind, place) -> the first file and its description.
    """

    name: str
    engine: str
    n_cases: int = 0
    n_read: int = 0
    n_judged: int | None = None
    slowest_s: float = 0.0
    memory: float = 0.0
    findings: dict[str, str] = field(default_factory=dict)

    def row(self) -> str:
        """Returns a row of the Markdown table."""
        judged = "-" if self.n_judged is None else f"{self.n_judged:,}"
        return (
            f"| {self.name} | {self.engine} | {self.n_cases:,} | {self.n_read:,} | {judged} | {len(self.findings)} | "
            f"{self.slowest_s:.2f} s | {100.0 * self.memory:.0f} % |"
        )


@dataclass(frozen=True)
class Plan:
    """Work of a child process.

    name: of the target.
    engine: "seeded" or "coverage".
    seed: of the random generator.
    first, n_cases: number of the first case, and number of cases.
    seconds: time after which no further case begins.
    """

    name: str
    engine: str
    seed: int
    first: int
    n_cases: int
    seconds: float


def main() -> int:
    """Fuzzes the targets that the command line names; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(NAMES)}; default: all")
    parser.add_argument("--minutes", type=float, help="time in all")
    parser.add_argument("--cases", type=int, help="files of each target; default: 2,000 without --minutes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--engine",
        choices=("seeded", "coverage"),
        help="default: coverage if atheris can be imported and --minutes is given",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="targets at a time")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        plan, folder = json.loads(options.child)
        return _Child(Plan(**plan), Path(folder)).run()
    names = options.targets or NAMES
    if unknown := [name for name in names if name not in NAMES]:
        parser.error(f"no target {unknown[0]!r}, expected of {', '.join(NAMES)}")
    engine = options.engine or ("coverage" if options.minutes and _has_atheris() else "seeded")
    jobs = min(options.jobs, len(names))
    seconds = 60.0 * options.minutes * jobs / len(names) if options.minutes else float("inf")
    n_cases = options.cases or (sys.maxsize if options.minutes else 2000)
    print("| target | cases chosen | cases | read and used | judged by the oracle | findings | slowest | "
          "memory, of what a case may take |")  # fmt: skip
    print("| --- " * 8 + "|", flush=True)
    with ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(_fuzz, Plan(name, engine, options.seed, 0, n_cases, seconds)) for name in names]
        tallies = []
        for future in as_completed(running):
            tallies.append(future.result())
            print(tallies[-1].row(), flush=True)
    for tally in tallies:
        for finding, description in tally.findings.items():
            print(f"\n{tally.name}: {finding}\n{description}")
    return int(any(tally.findings for tally in tallies))


def _has_atheris() -> bool:
    try:
        import atheris  # noqa: F401
    except ImportError:
        return False
    return True


def _fuzz(plan: Plan) -> Tally:
    """Returns the tally of a target; restarts a child that a case killed after that case."""
    tally = Tally(plan.name, plan.engine)
    end_time = time.monotonic() + plan.seconds
    base = "/dev/shm" if Path("/dev/shm").is_dir() else None  # in memory: cases read many files
    while tally.n_cases < plan.n_cases and time.monotonic() < end_time:
        with tempfile.TemporaryDirectory(prefix="fuzz-", dir=base) as name:
            remaining_s = min(end_time - time.monotonic(), 1e9)
            child_plan = Plan(
                plan.name, plan.engine, plan.seed + (plan.engine == "coverage") * tally.n_cases, tally.n_cases,
                plan.n_cases - tally.n_cases, remaining_s,
            )  # fmt: skip
            status, errors = _run_child(child_plan, Path(name))
            n_before = tally.n_cases
            _add_child_tally(tally, Path(name), status)
            if tally.n_cases == n_before:
                raise SystemExit(f"{plan.name}: the child did no case\n{errors[-3000:]}")
    return tally


def _run_child(plan: Plan, folder: Path) -> tuple[int, str]:
    command = [sys.executable, __file__, "--child", json.dumps([asdict(plan), str(folder)])]
    log = folder / "log"
    path = os.pathsep.join([str(ROOT / "tests"), *filter(None, [os.environ.get("PYTHONPATH")])])  # for avatars.py
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": path}
    with log.open("wb") as log_file:
        process = subprocess.run(command, stdout=log_file, stderr=log_file, check=False, env=environment)
    return process.returncode, log.read_text(errors="replace")


def _add_child_tally(tally: Tally, folder: Path, status: int) -> None:
    """Adds the results in a child's folder to the tally."""
    state = folder / "tally.json"
    if state.exists():
        child = json.loads(state.read_text())
        tally.n_cases += child["n_cases"]
        tally.n_read += child["n_read"]
        if child["n_judged"] is not None:
            tally.n_judged = (tally.n_judged or 0) + child["n_judged"]
        tally.slowest_s = max(tally.slowest_s, child["slowest_s"])
        tally.memory = max(tally.memory, child["memory"])
        tally.findings = {**child["findings"], **tally.findings}
    # SIGTERM and SIGINT come from outside
    if status not in (0, -signal.SIGTERM, -signal.SIGINT) and (folder / "case").exists():
        content = (folder / "case").read_bytes()
        kind = signal.Signals(-status).name if status < 0 else f"exit status {status}"
        ending = {-signal.SIGPROF: "hangs", -signal.SIGALRM: "waits without end"}.get(status, "dies")
        tally.n_cases += 1
        if status == -signal.SIGPROF:
            tally.slowest_s = max(tally.slowest_s, MAX_CPU_S)
        if f"{ending} ({kind})" not in tally.findings:
            tally.findings[f"{ending} ({kind})"] = _store_case(tally.name, content)


def _store_case(name: str, content: bytes) -> str:
    """Stores a file in the corpus, and returns a line with its path."""
    digest = hashlib.sha256(content).hexdigest()[:16]
    folder = CORPUS if len(content) <= MAX_STORED_FILE else Path(tempfile.gettempdir()) / "fuzz_corpus"
    path = folder / name / digest
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return f"    file: {path} ({len(content)} bytes)"


class _Child:
    """A process that runs the cases of a plan, and writes its tally into a folder as it goes."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.folder = plan, folder
        self.tally = Tally(plan.name, plan.engine)
        self.end_time = time.monotonic() + plan.seconds
        (folder / "files").mkdir()
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for kind in (signal.SIGPROF, signal.SIGALRM):  # the default action ends the process, also within a library
            signal.signal(kind, signal.SIG_DFL)

    def run(self) -> int:
        """Runs all cases; returns the exit status."""
        if self.plan.engine == "coverage":
            return self._run_atheris()
        from fuzz_targets import TARGETS

        target = TARGETS[self.plan.name]
        seeds, corpus = target.seeds(), self._read_corpus()
        for number in range(self.plan.first, self.plan.first + self.plan.n_cases):
            if time.monotonic() > self.end_time:
                break
            rng = random.Random(f"{self.plan.seed}/{self.plan.name}/{number}")
            files = corpus if corpus and rng.random() < 0.1 else seeds
            self._run_case(target.mutate_seed(files, rng), target)
        self._write()
        return 0

    def _run_atheris(self) -> int:
        import atheris

        with atheris.instrument_imports(include=["signsplice"]):
            from fuzz_targets import TARGETS
        target = TARGETS[self.plan.name]
        corpus = self.folder / "corpus"
        corpus.mkdir()
        for number, content in enumerate([*target.seeds(), *self._read_corpus()]):
            (corpus / str(number)).write_bytes(content)

        def run_case(content: bytes) -> None:
            self._run_case(content, target)
            if self.tally.n_cases >= self.plan.n_cases or time.monotonic() > self.end_time:
                self._write()
                os._exit(0)

        def mutate(content: bytes, max_size: int, seed: int) -> bytes:
            return target.mutate_seed([content], random.Random(seed))[:max_size]

        options = ["-timeout=0", "-rss_limit_mb=0", "-max_len=1000000", "-len_control=0", "-verbosity=0"]
        atheris.Setup(
            [sys.argv[0], *options, f"-seed={self.plan.seed + 1}", str(corpus)], run_case, custom_mutator=mutate
        )
        atheris.Fuzz()
        return 0

    def _read_corpus(self) -> list[bytes]:
        return [path.read_bytes() for path in sorted((CORPUS / self.plan.name).glob("*")) if path.is_file()]

    def _run_case(self, content: bytes, target: Target) -> None:
        """Runs a case under its limits, judges it, and adds it to the tally."""
        (self.folder / "case").write_bytes(content)
        size, loaded = target.unpacked(content), None
        start_memory, start = _reset_peak_memory(), time.process_time()
        signal.setitimer(signal.ITIMER_PROF, MAX_CPU_S)
        signal.setitimer(signal.ITIMER_REAL, MAX_WAIT_S)
        try:
            loaded, was_used = target.exercise(content, self.folder / "files")
            self.tally.n_read += was_used
        except Exception as error:
            self._add_finding(
                _describe_place(error), f"    {traceback.format_exception_only(error)[-1].strip()[:300]}", content
            )
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        self.tally.slowest_s = max(self.tally.slowest_s, time.process_time() - start)
        fraction = (_read_memory("VmHWM") - start_memory) / (BASE_MEMORY + 10 * size)
        if fraction > 1.0:
            self._add_finding(
                "memory", f"{fraction * (BASE_MEMORY + 10 * size) / 2**20:.0f} MiB for {size} bytes", content
            )
        self.tally.memory = max(self.tally.memory, fraction)
        if target.oracle is not None:
            self._judge(content, loaded, target)
        self.tally.n_cases += 1
        if self.tally.n_cases % 10 == 0 or self.plan.n_cases < 100:
            self._write()

    def _judge(self, content: bytes, loaded: object, target: Target) -> None:
        """Lets the oracle judge what was read."""
        self.tally.n_judged = self.tally.n_judged or 0
        try:
            self.tally.n_judged += target.judge(content, loaded)
        except AssertionError as error:
            self.tally.n_judged += 1
            kind = re.sub(r"'.*?'|[-+]?\d[-+.\de]*", "_", str(error))  # one finding for each check of the oracle
            self._add_finding(f"wrong motion, {kind[:80]}", f"    {str(error)[:300]}", content)

    def _add_finding(self, finding: str, description: str, content: bytes) -> None:
        if finding not in self.tally.findings:
            self.tally.findings[finding] = description.rstrip() + "\n" + _store_case(self.plan.name, content)
            self._write()

    def _write(self) -> None:
        path = self.folder / "tally.json"
        path.with_suffix(".new").write_text(json.dumps(asdict(self.tally)))
        path.with_suffix(".new").replace(path)


def _describe_place(error: BaseException) -> str:
    """Returns the kind of an exception, and the last line of the package that it passed."""
    frames = traceback.extract_tb(error.__traceback__)
    inside = [frame for frame in frames if "signsplice" in Path(frame.filename).parts] or list(frames)
    return f"{type(error).__name__} in {Path(inside[-1].filename).name}:{inside[-1].lineno} {inside[-1].name}"


def _reset_peak_memory() -> int:
    """Resets the process's peak of memory and returns its present memory, bytes."""
    Path("/proc/self/clear_refs").write_text("5")
    return _read_memory("VmRSS")


def _read_memory(name: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name):
            return int(line.split()[1]) << 10
    raise SystemExit(f"/proc/self/status has no {name}")


if __name__ == "__main__":
    sys.exit(main())
