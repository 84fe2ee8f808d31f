"""Some 170 outputs made by one command, and their hashes: what a change must leave the same, bit for bit.

    python runs/outputs.py make OUT [--python PYTHON] [--paper "-m signsplice_paper"] [--results DIR] [--system DIR]
    python runs/outputs.py compare OLD/outputs.tsv NEW/outputs.tsv

``make`` runs the command line and ``import signsplice`` of PYTHON (of this checkout, or another one through PYTHONPATH)
on words that ship, and writes OUT/outputs.tsv: a line an output with name, bytes and SHA-256. ``compare`` prints what
differs and exits with 1 if anything does. Numbers hold for one kind of processor: compare what one machine made.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

WORDS = ("HELLO", "I", "DEAF", "SIGN", "THANK-YOU", "NAME", "MOTHER", "BOOK", "fs-A", "fs-N")
CUTTERS = ("ends", "rest-trim", "hand-distance", "pose-velocity", "learned", "learned-fluent")
TRANSITIONS = ("hold", "linear", "slerp", "minimum-jerk", "hermite", "quintic", "inertialize", "learned")
DURATIONS = ("fixed", "travel", "speed", "tempo", "learned", "0.4", "0")
LINES = {
    "name": "HELLO MY NAME fs-ANNA",
    "doubled": "fs-LEE BOOK fs-OTTO",
    "slides": "fs-HILL fs-ABBY I",
    "typed": "Mother, I love you! My name is Anna.",
    "unknown": "HELLO ZYX BOOK",
    "long": "I LIKE COFFEE MOTHER BOOK SIGN DEAF HELLO NAME THANK-YOU I BOOK MOTHER",
}


def cases() -> Iterator[tuple[str, list[str]]]:
    """Calls of the command line: (name, words); ``{o}`` is the folder of the call's outputs."""
    two, four = ["HELLO.bvh", "DEAF.bvh"], ["I.bvh", "MOTHER.bvh", "NAME.bvh", "BOOK.bvh"]
    out = ["-o", "{o}/out.bvh", "--report", "{o}/report.json"]
    for cutter in CUTTERS:
        yield f"splice-cutter-{cutter}", ["splice", *four, *out, "--cutter", cutter]
        for transition in ("hermite", "learned"):
            yield f"splice-{cutter}-{transition}", ["splice", *two, *out, "--cutter", cutter, "--transition", transition]
    for transition in TRANSITIONS:
        yield f"splice-transition-{transition}", ["splice", *four, *out, "--transition", transition]
        yield f"inbetween-{transition}", [
            *("inbetween", "DEAF.bvh", "--gap", "10:18", "--gap", "30:31"), *out, "--transition", transition,
        ]  # fmt: skip
    for seconds in DURATIONS:
        yield f"splice-time-{seconds}", ["splice", *four, *out, "--transition-time", seconds]
    dials = {
        "plain": [],
        "speed": ["--sign-speed", "1.3"],
        "slow": ["--sign-speed", "0.7"],
        "fps": ["--fps", "24"],
        "fps-up": ["--fps", "59.94"],
        "natural": ["--tempo", "natural"],
        "seconds": ["--tempo", "0.9"],
        "idle": ["--free-hand", "natural"],
        "collisions": ["--avoid-collisions", "--transition", "quintic"],
        "no-collisions": ["--no-avoid-collisions"],
        "all": ["--tempo", "natural", "--free-hand", "natural", "--sign-speed", "1.1", "--fps", "25"],
    }
    for name, options in dials.items():
        yield f"splice-dial-{name}", ["splice", *four, *out, *options]
        yield f"sentence-dial-{name}", ["sentence", LINES["name"], *out, *options]
    for suffix in (".glb", ".vrma", ".npz", ".png", ".gif"):
        yield f"splice-to{suffix}", ["splice", *two, "-o", f"{{o}}/out{suffix}"]
        yield f"convert-to{suffix}", [*("render" if suffix in (".png", ".gif") else "convert",), "BOOK.bvh", f"{{o}}/o{suffix}"]
    for name, files in {
        "mixed-units": ["HELLO.bvh", "SCALED.bvh", "DEAF.glb"],
        "units-first": ["SCALED.bvh", "HELLO.bvh"],
        "glb-first": ["DEAF.glb", "HELLO.bvh"],
        "rates": ["HELLO.bvh", "SLOWED.bvh", "DEAF.bvh"],
        "rates-first": ["SLOWED.bvh", "DEAF.bvh"],
        "one": ["BOOK.bvh"],
        "letters": ["fs-A.bvh", "fs-N.bvh", "fs-N.bvh", "fs-A.bvh"],
        "letter-sign": ["fs-A.bvh", "BOOK.bvh", "fs-N.bvh"],
        "npz": ["NAME.npz", "BOOK.bvh"],
    }.items():
        yield f"splice-{name}", ["splice", *files, *out]
        yield f"splice-{name}-natural", ["splice", *files, *out, "--tempo", "natural"]
    for name, line in LINES.items():
        yield f"sentence-{name}", ["sentence", line, *out]
        yield f"sentence-{name}-natural", ["sentence", line, *out, "--tempo", "natural", "--free-hand", "natural"]
        yield f"sentence-{name}-classical", ["sentence", line, *out, "--cutter", "pose-velocity", "--transition", "quintic"]
    yield "sentence-lexicon", ["sentence", "HELLO BOOK I", *out, "--lexicon", "LEX"]
    yield "sentence-no-spell", ["sentence", LINES["unknown"], *out, "--no-spell"]
    yield "sentence-no-compounds", ["sentence", "I LOVE YOU", *out, "--no-compounds"]
    for source in ("BOOK.bvh", "DEAF.glb", "NAME.npz", "SCALED.bvh"):
        yield f"inspect-{source}", ["inspect", source, "--json"]
        yield f"convert-{source}", ["convert", source, "{o}/out.bvh"]
        yield f"convert-onto-{source}", ["convert", source, "{o}/out.bvh", "--onto", "NARROW.bvh", "--report", "{o}/r.json"]
    yield "convert-avatar", ["convert", "MOTHER.bvh", "{o}/out.vrma", "--avatar", "DEAF.glb", "--report", "{o}/r.json"]
    yield "render-report", ["render", "SPLICED.bvh", "{o}/o.png", "--report", "SPLICED.json", "--view", "side"]
    yield "render-film", ["render", "DEAF.bvh", "{o}/o.gif", "--size", "200x160", "--view", "three-quarter"]
    yield "lexicon-build", ["lexicon", "build", "words", "-o", "{o}/lex"]
    yield "lexicon-compact", ["lexicon", "build", "words", "-o", "{o}/lex", "--compact"]
    yield "lexicon-list", ["lexicon", "list", "LEX"]
    yield "lexicon-check", ["lexicon", "check", "LEX"]
    yield "synth-lexicon", ["synth", "lexicon", "-o", "{o}/words", "--words", "3", "--pseudo", "3", "--form", "2-GIVE-1"]
    yield "synth-sentences", ["synth", "sentences", "-o", "{o}/s", "--count", "2"]
    for truth in ("partner", "word"):
        yield f"synth-pairs-{truth}", ["synth", "pairs", "-o", "{o}/pairs", "--words", "3", "--truth", truth]
    yield "bulk-recipes", ["bulk", "recipes", "-o", "{o}/r.csv", "--count", "6", "--words", "2:4"]
    for store in ("frames", "recipes"):
        yield f"bulk-store-{store}", ["bulk", "sentences", "RECIPES.csv", "-o", "{o}/b", "--workers", "1", "--store", store]
    yield "evaluate-clips", ["evaluate", "--clips", "BOOK.bvh", "--json"]
    yield "evaluate-seams", ["evaluate", "--seams", "3", "--json"]
    yield "evaluate-bodies", ["evaluate", "--bodies", "3", "--json"]
    yield "evaluate-tempo", ["evaluate", "--tempo", "7", "--json"]


def call(words: list[str]) -> tuple[str, str, str]:
    """Status, standard output and standard error of a call of the command line, in this process."""
    from signsplice.cli import main as run

    shown, errors, status = io.StringIO(), io.StringIO(), 0
    arguments, sys.argv = sys.argv, ["signsplice", *words]
    try:
        with redirect_stdout(shown), redirect_stderr(errors):
            run()
    except SystemExit as stop:
        status = int(stop.code or 0)
    finally:
        sys.argv = arguments
    return f"status {status}", shown.getvalue(), errors.getvalue()


def prepare(folder: Path, system: str | None) -> None:
    """Clips, a lexicon and recipes that the calls read."""
    from dataclasses import replace

    import signsplice as ss
    from signsplice.lexicon import shipped

    (folder / "words").mkdir(parents=True)
    with shipped() as lexicon:
        for gloss in WORDS:
            clip = lexicon.clip(gloss)
            ss.save(clip, folder / f"{gloss}.bvh")
            ss.save(clip, folder / "words" / f"{gloss}.bvh")
        ss.save(lexicon.clip("DEAF"), folder / "DEAF.glb")
        ss.save(lexicon.clip("NAME"), folder / "NAME.npz")
        sign = lexicon.clip("SIGN")
    bones = sign.skeleton
    small = replace(bones, offsets=0.01 * bones.offsets)
    ss.save(ss.Clip(small, sign.local_rotations, 0.01 * sign.root_positions, 30.0, "SCALED"), folder / "SCALED.bvh")
    ss.save(ss.Clip(bones, sign.local_rotations, sign.root_positions, 24.0, "SLOWED"), folder / "SLOWED.bvh")
    narrow = bones.offsets.copy()
    narrow[:, 0] *= 0.8
    still = ss.Clip(replace(bones, offsets=narrow), sign.local_rotations, sign.root_positions, 30.0, "NARROW")
    ss.save(still, folder / "NARROW.bvh")
    os.chdir(folder)
    call(["lexicon", "build", "words", "-o", "LEX"])
    call(["bulk", "recipes", "-o", "RECIPES.csv", "--count", "6", "--words", "2:4", "--seed", "3"])
    call(["splice", "HELLO.bvh", "BOOK.bvh", "-o", "SPLICED.bvh", "--report", "SPLICED.json"])


def from_python(folder: Path, system: str | None) -> None:
    """What the public names give: streams, many sentences, another body, a system of the paper."""
    import signsplice as ss
    from signsplice.splicing.bulk_splice import splice_many

    words = [ss.load(f"{gloss}.bvh") for gloss in ("HELLO", "I", "DEAF", "fs-A", "fs-N", "fs-N", "fs-A", "BOOK")]
    options = [ss.SpliceOptions(), ss.SpliceOptions(tempo="natural", free_hand="natural")]
    for number, chosen in enumerate(options):
        for k, piece in enumerate(ss.stream(words, chosen)):
            ss.save(piece.clip, folder / f"stream-{number}-{k}.npz")
        for k, result in enumerate(splice_many([words[:3], words[2:], words], chosen, starts=[(), (3,), ()])):
            assert isinstance(result, ss.SpliceResult)
            ss.save(result.clip, folder / f"many-{number}-{k}.npz")
            (folder / f"many-{number}-{k}.txt").write_text(repr((result.spans, result.seams, result.warnings)))
    ss.save(ss.retarget(words[7], ss.load("NARROW.bvh")).clip, folder / "retarget.npz")
    ss.save(ss.inbetween(words[0], [(20, 30)]).clip, folder / "inbetween.npz")
    if system:
        out = folder / "system"
        out.mkdir()
        line = ["splice", "HELLO.bvh", "DEAF.bvh", "--fill-misses", "--system", system]
        status = call([*line, "-o", str(out / "out.bvh"), "--report", str(out / "r.json")])
        (out / "call.txt").write_text("\n".join(status))


def inside(folder: Path, system: str | None) -> None:
    """Make all outputs with this interpreter."""
    made = folder / "made"
    prepare(folder / "work", system)
    for name, words in cases():
        out = made / name
        out.mkdir(parents=True)
        results = call([word.replace("{o}", str(out)) for word in words])
        (out / "call.txt").write_text("\n".join(results))
    (made / "python").mkdir()
    from_python(made / "python", system)


def normalised(path: Path, folder: Path) -> bytes:
    """The bytes of an output without what honestly differs between two runs: times, this machine's folders, versions,
    commits; of an archive or a table of SQLite, what it holds.
    """
    content = path.read_bytes()
    if path.suffix == ".tar":
        with tarfile.open(path) as tar:
            return b"".join(m.name.encode() + (tar.extractfile(m) or io.BytesIO()).read() for m in tar if m.isfile())
    if path.suffix in (".json", ".txt", ".csv", ".jsonl"):
        text = content.decode("utf-8").replace(str(folder), "OUT")
        text = re.sub(r'"timing_ms": \{[^}]*\}', '"timing_ms": {}', text)
        text = re.sub(r'"(milliseconds|times_copying|created|version|signsplice|commit)": ("[^"]*"|[\d.e-]+)', r'"\1": 0', text)
        text = re.sub(r"\b\d+(\.\d+)? (ms|s) (a|of) (seam|processor)\b", "TIME", text)
        return text.encode()
    return content


def listing(folder: Path) -> Iterator[tuple[str, int, str]]:
    """Name, size and hash of every output below a folder."""
    for path in sorted((folder / "made").rglob("*")):
        if path.is_file():
            content = normalised(path, folder)
            yield path.relative_to(folder / "made").as_posix(), len(content), hashlib.sha256(content).hexdigest()


def make(arguments: argparse.Namespace) -> None:
    """Make all outputs with the interpreter that was named, and write their listing."""
    folder = Path(arguments.out).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    system = [] if arguments.system is None else ["--system", str(Path(arguments.system).resolve())]
    subprocess.run([arguments.python, __file__, "inside", str(folder), *system], env=environment, check=True)
    if arguments.results:
        out = folder / "made" / "paper"
        shutil.copytree(arguments.results, out)
        for old in [*out.rglob("*.md"), *out.rglob("*.csv"), *out.rglob("*.svg"), *out.rglob("*.tex")]:
            old.unlink()
        call_of_paper = [arguments.python, *arguments.paper.split(), "tables", "--out", str(out)]
        subprocess.run(call_of_paper, env=environment, check=True, stdout=subprocess.DEVNULL)
    rows = list(listing(folder))
    text = "".join(f"{name}\t{size}\t{digest}\n" for name, size, digest in rows)
    (folder / "outputs.tsv").write_text(text)
    print(f"{folder / 'outputs.tsv'}: {len(rows)} files of {len({row[0].split('/')[0] for row in rows})} calls")


def compare(old: str, new: str) -> int:
    """Print what differs between two listings; how many lines do."""
    before, after = (
        {line.split("\t")[0]: line for line in Path(file).read_text().splitlines() if not line.startswith("#")}
        for file in (old, new)
    )
    different = [name for name in {**before, **after} if before.get(name) != after.get(name)]
    for name in sorted(different):
        what = "missing" if name not in after else "new" if name not in before else "differs"
        print(f"{what:8} {name}")
    print(f"{len(before)} outputs before, {len(after)} after, {len(different)} not the same")
    return len(different)


def main() -> None:
    """Run the command of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("make", "inside"):
        one = commands.add_parser(name)
        one.add_argument("out")
        one.add_argument("--python", default=sys.executable)
        one.add_argument("--paper", default="-m signsplice_paper")
        one.add_argument("--results", help="folder of the paper's results.json, whose tables are made anew")
        one.add_argument("--system", help="bundle of one of the paper's systems")
    both = commands.add_parser("compare")
    both.add_argument("old")
    both.add_argument("new")
    arguments = parser.parse_args()
    if arguments.command == "make":
        make(arguments)
    elif arguments.command == "inside":
        inside(Path(arguments.out), arguments.system)
    else:
        sys.exit(1 if compare(arguments.old, arguments.new) else 0)


if __name__ == "__main__":
    main()
