"""Fuzzes every kind of file that the program reads, and prints a Markdown row for each.

    python attacks/fuzz.py --minutes 10             all targets, in ten minutes
    python attacks/fuzz.py --cases 20000 npz gltf   an exact number of cases of two of them

A case is a finding where an exception other than ``InputError`` comes out of the reader or of the next step, where its
error is not one line with the file's name, where it takes more than ``MOST_SECONDS`` of processor time or more memory
than ``FREE_MEMORY`` and ten times the file's unpacked size, and where the process dies. Motion that is read is judged
by an oracle that shares no code with the reader (``fuzz_oracles``): another motion than the file's is a finding too.
Its file is then kept in workshop/tests/fuzz_corpus, for a test that reads it for ever. The exit status is 1 where
something was found.

Cases are mutations by a seeded generator, the same in each run, or (``--engine coverage``) chosen by atheris for the
lines of code that they reach. They run in a child process, which is started anew where a case kills it. Linux only.
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
"""The targets, those that take longest first."""
MOST_SECONDS = 5.0
"""Of processor time for a case."""
MOST_WAITING_S = 60.0
"""Of time on the clock for a case, whatever it waits for."""
FREE_MEMORY = 64 << 20
"""Bytes that a case may take beside ten times the unpacked size of its file."""
ADDRESS_SPACE = 8 << 30
LARGEST_KEPT = 200_000
"""Bytes of the largest file that is kept in the corpus."""


@dataclass
class Tally:
    """What the cases of a target came to.

    name, engine: of the target, and what chose the cases.
    n_cases: number of files.
    n_read: how many were read and used without an error.
    n_judged: how many the oracle has judged; None where there is none.
    slowest_s: processor time of the slowest case.
    memory: greatest fraction that a case took of the memory that it may.
    findings: (kind, place) -> the first file, and what was seen.
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
        """A row of the Markdown table."""
        judged = "-" if self.n_judged is None else f"{self.n_judged:,}"
        return (
            f"| {self.name} | {self.engine} | {self.n_cases:,} | {self.n_read:,} | {judged} | {len(self.findings)} | "
            f"{self.slowest_s:.2f} s | {100.0 * self.memory:.0f} % |"
        )


@dataclass(frozen=True)
class Plan:
    """The work of a child process.

    name: of the target.
    engine: "seeded" or "coverage".
    seed: of the random generator.
    first, n_cases: numbers of the first case, and of how many follow.
    seconds: after which no further case is begun.
    """

    name: str
    engine: str
    seed: int
    first: int
    n_cases: int
    seconds: float


def main() -> int:
    """Fuzz the targets that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(NAMES)}; all where none is named")
    parser.add_argument("--minutes", type=float, help="how long, in all")
    parser.add_argument("--cases", type=int, help="how many files of each target; 2,000 where no minutes are given")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--engine", choices=("seeded", "coverage"), help="coverage where atheris can be imported")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="targets at a time")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        plan, folder = json.loads(given.child)
        return _Child(Plan(**plan), Path(folder)).run()
    names = given.targets or NAMES
    if unknown := [name for name in names if name not in NAMES]:
        parser.error(f"no target {unknown[0]!r}, expected of {', '.join(NAMES)}")
    engine = given.engine or ("coverage" if given.minutes and _has_atheris() else "seeded")
    jobs = min(given.jobs, len(names))
    seconds = 60.0 * given.minutes * jobs / len(names) if given.minutes else float("inf")
    n_cases = given.cases or (sys.maxsize if given.minutes else 2000)
    print("| target | cases chosen | cases | read and used | judged by the oracle | findings | slowest | "
          "memory, of what a case may take |")  # fmt: skip
    print("| --- " * 8 + "|", flush=True)
    with ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(_fuzz, Plan(name, engine, given.seed, 0, n_cases, seconds)) for name in names]
        tallies = []
        for done in as_completed(running):
            tallies.append(done.result())
            print(tallies[-1].row(), flush=True)
    for tally in tallies:
        for what, seen in tally.findings.items():
            print(f"\n{tally.name}: {what}\n{seen}")
    return int(any(tally.findings for tally in tallies))


def _has_atheris() -> bool:
    try:
        import atheris  # noqa: F401
    except ImportError:
        return False
    return True


def _fuzz(plan: Plan) -> Tally:
    """The tally of a target; a child that a case killed is started anew after that case."""
    tally = Tally(plan.name, plan.engine)
    ends = time.monotonic() + plan.seconds
    base = "/dev/shm" if Path("/dev/shm").is_dir() else None  # the files that cases read need no disk
    while tally.n_cases < plan.n_cases and time.monotonic() < ends:
        with tempfile.TemporaryDirectory(prefix="fuzz-", dir=base) as name:
            left = min(ends - time.monotonic(), 1e9)
            part = Plan(plan.name, plan.engine, plan.seed + (plan.engine == "coverage") * tally.n_cases, tally.n_cases,
                        plan.n_cases - tally.n_cases, left)  # fmt: skip
            status, errors = _run_child(part, Path(name))
            before = tally.n_cases
            _add(tally, Path(name), status)
            if tally.n_cases == before:
                raise SystemExit(f"{plan.name}: the child did no case\n{errors[-3000:]}")
    return tally


def _run_child(plan: Plan, folder: Path) -> tuple[int, str]:
    command = [sys.executable, __file__, "--child", json.dumps([asdict(plan), str(folder)])]
    log = folder / "log"
    path = os.pathsep.join([str(ROOT / "tests"), *filter(None, [os.environ.get("PYTHONPATH")])])  # for its avatars
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": path}
    with log.open("wb") as out:
        done = subprocess.run(command, stdout=out, stderr=out, check=False, env=environment)
    return done.returncode, log.read_text(errors="replace")


def _add(tally: Tally, folder: Path, status: int) -> None:
    """Add what a child has left in its folder to the tally."""
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
    if status not in (0, -signal.SIGTERM, -signal.SIGINT) and (folder / "case").exists():  # these come from outside
        content = (folder / "case").read_bytes()
        kind = signal.Signals(-status).name if status < 0 else f"exit status {status}"
        ends = {-signal.SIGPROF: "hangs", -signal.SIGALRM: "waits without end"}.get(status, "dies")
        tally.n_cases += 1
        if status == -signal.SIGPROF:
            tally.slowest_s = max(tally.slowest_s, MOST_SECONDS)
        if f"{ends} ({kind})" not in tally.findings:
            tally.findings[f"{ends} ({kind})"] = _keep(tally.name, content)


def _keep(name: str, content: bytes) -> str:
    """Keep a file in the corpus, and say where."""
    digest = hashlib.sha256(content).hexdigest()[:16]
    folder = CORPUS if len(content) <= LARGEST_KEPT else Path(tempfile.gettempdir()) / "fuzz_corpus"
    path = folder / name / digest
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return f"    file: {path} ({len(content)} bytes)"


class _Child:
    """A process that runs the cases of a plan, and writes what it sees into a folder as it goes."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.folder = plan, folder
        self.tally = Tally(plan.name, plan.engine)
        self.ends = time.monotonic() + plan.seconds
        (folder / "files").mkdir()
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for kind in (signal.SIGPROF, signal.SIGALRM):  # ends the process, also within a library
            signal.signal(kind, signal.SIG_DFL)

    def run(self) -> int:
        """Run all cases; the exit status."""
        if self.plan.engine == "coverage":
            return self._run_atheris()
        from fuzz_targets import TARGETS

        target = TARGETS[self.plan.name]
        seeds, kept = target.seeds(), self._kept()
        for number in range(self.plan.first, self.plan.first + self.plan.n_cases):
            if time.monotonic() > self.ends:
                break
            rng = random.Random(f"{self.plan.seed}/{self.plan.name}/{number}")
            chosen = kept if kept and rng.random() < 0.1 else seeds
            self._one(target.mutated(chosen, rng), target)
        self._write()
        return 0

    def _run_atheris(self) -> int:
        import atheris

        with atheris.instrument_imports(include=["signsplice"]):
            from fuzz_targets import TARGETS
        target = TARGETS[self.plan.name]
        corpus = self.folder / "corpus"
        corpus.mkdir()
        for number, content in enumerate([*target.seeds(), *self._kept()]):
            (corpus / str(number)).write_bytes(content)

        def one(content: bytes) -> None:
            self._one(content, target)
            if self.tally.n_cases >= self.plan.n_cases or time.monotonic() > self.ends:
                self._write()
                os._exit(0)

        def mutated(content: bytes, most: int, seed: int) -> bytes:
            return target.mutated([content], random.Random(seed))[:most]

        options = ["-timeout=0", "-rss_limit_mb=0", "-max_len=1000000", "-len_control=0", "-verbosity=0"]
        atheris.Setup([sys.argv[0], *options, f"-seed={self.plan.seed + 1}", str(corpus)], one, custom_mutator=mutated)
        atheris.Fuzz()
        return 0

    def _kept(self) -> list[bytes]:
        return [path.read_bytes() for path in sorted((CORPUS / self.plan.name).glob("*")) if path.is_file()]

    def _one(self, content: bytes, target: Target) -> None:
        """Run a case under its limits, judge it, and tally it."""
        (self.folder / "case").write_bytes(content)
        size, loaded = target.unpacked(content), None
        before, began = _memory_anew(), time.process_time()
        signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
        signal.setitimer(signal.ITIMER_REAL, MOST_WAITING_S)
        try:
            loaded, was_used = target.exercise(content, self.folder / "files")
            self.tally.n_read += was_used
        except Exception as error:
            self._found(_place(error), f"    {traceback.format_exception_only(error)[-1].strip()[:300]}", content)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        self.tally.slowest_s = max(self.tally.slowest_s, time.process_time() - began)
        fraction = (_memory("VmHWM") - before) / (FREE_MEMORY + 10 * size)
        if fraction > 1.0:
            self._found("memory", f"{fraction * (FREE_MEMORY + 10 * size) / 2**20:.0f} MiB for {size} bytes", content)
        self.tally.memory = max(self.tally.memory, fraction)
        if target.oracle is not None:
            self._judge(content, loaded, target)
        self.tally.n_cases += 1
        if self.tally.n_cases % 10 == 0 or self.plan.n_cases < 100:
            self._write()

    def _judge(self, content: bytes, loaded: object, target: Target) -> None:
        """Let the oracle judge what was read."""
        self.tally.n_judged = self.tally.n_judged or 0
        try:
            self.tally.n_judged += target.judge(content, loaded)
        except AssertionError as error:
            self.tally.n_judged += 1
            kind = re.sub(r"'.*?'|[-+]?\d[-+.\de]*", "_", str(error))  # one place in the oracle finds them all
            self._found(f"wrong motion, {kind[:80]}", f"    {str(error)[:300]}", content)

    def _found(self, what: str, seen: str, content: bytes) -> None:
        if what not in self.tally.findings:
            self.tally.findings[what] = seen.rstrip() + "\n" + _keep(self.plan.name, content)
            self._write()

    def _write(self) -> None:
        path = self.folder / "tally.json"
        path.with_suffix(".new").write_text(json.dumps(asdict(self.tally)))
        path.with_suffix(".new").replace(path)


def _place(error: BaseException) -> str:
    """Kind of an exception, and the last line of the package that it passed."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "signsplice" in Path(frame.filename).parts] or list(frames)
    return f"{type(error).__name__} in {Path(own[-1].filename).name}:{own[-1].lineno} {own[-1].name}"


def _memory_anew() -> int:
    """Bytes of memory that the process has now; its peak is counted from here on."""
    Path("/proc/self/clear_refs").write_text("5")
    return _memory("VmRSS")


def _memory(name: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name):
            return int(line.split()[1]) << 10
    raise SystemExit(f"/proc/self/status has no {name}")


if __name__ == "__main__":
    sys.exit(main())
