"""Makes some 150 outputs of an installation by every interface, and lists name, size and SHA-256 of their files.

The list proves that a refactoring leaves the product's outputs the same, bit for bit:

    python workshop/runs/outputs.py make --python .venv/bin/python -o OLD            # some minutes on one core
    PYTHONPATH=src:workshop/src:research/src python workshop/runs/outputs.py make --python .venv/bin/python -o NEW \
        --paper research/docs --bundles research/bundles --command "paper=-m signsplice_paper" \
        --command "pairs=-m signsplice_paper pairs"
    python workshop/runs/outputs.py compare OLD/outputs.tsv NEW/outputs.tsv          # status 1 if anything differs

``make`` runs the calls of outputs.txt, which lies beside this file, and public Python names with that interpreter, most
of them in one process, in the folder that it makes. Each call leaves its files and NAME.txt: exit status, standard
output and error. ``normalise`` removes varying parts, in place, so that ``diff -r OLD NEW`` shows the differences. Bits
depend on the processor: compare lists of one kind of processor. ``--system`` finds the paper's systems by an entry
point, for which the distribution has to be installed.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import hashlib
import importlib
import io
import itertools
import json
import os
import re
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import time
import traceback
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
HOMES = {
    "shipped": ("signsplice.lexicon:open_shipped_lexicon", "signsplice.lexicon:shipped", "signsplice:open_lexicon"),
    "parse": ("signsplice.lexicon.sentence:parse",),
    "describe": ("signsplice.splicing.report:describe",),
    "Stream": ("signsplice.splicing.engine:Stream", "signsplice:Stream"),
    "Word": ("signsplice.splicing.word:Word",),
    "splice_many": ("signsplice.splicing.bulk_splice:splice_many", "signsplice:splice_many"),
}
"""Modules of documented names that ``import signsplice`` does not have; the first module with the name is used."""
WORDS = ("HELLO", "DEAF", "NAME", "SIGN", "THANK-YOU", "I", "MOTHER", "BOOK", "FRIEND", "fs-A", "fs-N")
PAPER_FILES = ("results.json", "frames.npz", "search.json")
VALUES = {
    "suffix": "bvh npz glb vrma",
    "cutter": "learned-fluent ends hand-distance pose-velocity",
    "some": "learned hermite slerp",
    "transition": "learned hold linear slerp minimum-jerk hermite quintic inertialize",
    "time": "auto tempo travel speed fixed 0.5 0",
    "speed": "0.7 2",
    "fps": "24 60",
    "tempo": "natural 0.9",
    "kind": "NAME metres fast stray long-arms",
    "system": "lpt-plus lptransformer transformer lstm conv-s2s",
}
LINES = ("HELLO I DEAF", "MY NAME fs-ANNA fs-BOB", "BOOK I MOTHER NAME", "I LOVE YOU, FRIEND!")
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"tempo": "natural"},
    {"free_hand": "natural"},
    {"cutter": "learned-fluent", "duration": "tempo"},
    {"cutter": "rest-trim", "transition": "quintic", "sign_speed": 1.3, "avoid_collisions": True},
)
"""Sentences and options of the calls in Python."""


def normalise(name: str, content: bytes, places: dict[str, str]) -> bytes:
    """Returns a file's bytes without parts that vary between two runs of the same code, or with the version's
    number.
    """
    if name.endswith(".parquet"):  # only rows: the metadata contain the job's hash, and that the package's version
        import pyarrow.parquet as pq

        rows = pq.read_table(io.BytesIO(content)).to_pylist()
        return "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows).encode()
    if not name.endswith((".json", ".txt", ".csv", ".md")):
        return content  # motion, networks, pictures and archives stay as they are
    text = content.decode()
    for place, word in places.items():  # folders of this machine: package and checkout
        text = text.replace(place, word)
    text = re.sub(r'"timing_ms": ?\{[^}]*\}', '"timing_ms": {}', text)  # milliseconds that a splice took
    if name.startswith("evaluate/bodies"):  # time of a fit, as JSON and as the last two columns of a table
        text = re.sub(r'"(milliseconds|time_ratio)": [^,\n]+', r'"\1": 0', text)
        text = re.sub(r"(?m)( \| [\d.-]+){2} \|$", " | | |", text)
    if name.endswith("job.json"):  # versions of package and libraries, and the processor
        text = re.sub(r'"(signsplice|processor)": "[^"]*"', r'"\1": ""', text)
        text = re.sub(r'"made_with": \{[^}]*\}', '"made_with": {}', text)
    return text.encode()


def import_name(name: str) -> Any:
    """Imports a name of ``HOMES``."""
    for home in HOMES[name]:
        module, _, attribute = home.partition(":")
        with contextlib.suppress(ImportError, AttributeError):
            return getattr(importlib.import_module(module), attribute)
    raise ImportError(f"{name} is in none of {', '.join(HOMES[name])}")


def read_calls() -> Iterator[tuple[str, list[str], bool]]:
    """Yields name, words, and whether it has its own process, of every call of the command line, in order."""
    for row in (HERE / "outputs.txt").read_text().splitlines():
        if row.startswith("#"):
            continue
        keys = dict.fromkeys(re.findall(r"\{(\w+)\}", row))
        for values in itertools.product(*(VALUES[key].split() for key in keys)):
            filled = row.removeprefix("! ")
            for key, value in zip(keys, values, strict=True):
                filled = filled.replace(f"{{{key}}}", value)
            name, *words = shlex.split(filled.replace(" >", " -o @.bvh --report @.json"))
            words = [re.sub(r"^:(.*)", r"in/\1.bvh", word.replace("@", name)) for word in words]
            yield name, words, row.startswith("!")


class Maker:
    """Makes the outputs in the current folder.

    moved: commands that moved, as (["paper"], ["-m", "signsplice_paper"]).
    """

    def __init__(self, checkout: str, paper: str, bundles: str, moved: list[str]) -> None:
        self.checkout, self.paper, self.bundles = checkout, paper, bundles
        self.moved = [[shlex.split(part) for part in text.split("=", 1)] for text in moved]
        self.seconds: dict[str, float] = {}

    def make(self) -> None:
        """Makes everything."""
        self.run_timed("in/clips", self.write_inputs)
        self.run_timed("in/avatars", self.write_avatars)
        for write_outputs in (python_splices, python_streams, python_bodies):
            self.run_timed(f"python/{write_outputs.__name__}", write_outputs)
        for name, words, own_process in read_calls():
            self.run_timed(name, self.call, words, own_process)
        self.run_timed("serve/answers", serve)

    def run_timed(self, name: str, make: Callable[..., object], *arguments: Any) -> None:
        """Makes one output of the list; an exception is stored as its output, so that the others are made all the
        same.
        """
        start = time.perf_counter()
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        try:
            make(name, *arguments)
        except Exception as error:
            Path(f"{name}.failed.txt").write_text("".join(traceback.format_exception_only(error)))
        self.seconds[name] = time.perf_counter() - start

    def call(self, name: str, words: list[str], own_process: bool = False) -> str:
        """Runs a call, writes its status and output to NAME.txt, and returns its standard output."""
        words = [word.replace("CHECKOUT", self.checkout).replace("BUNDLES", self.bundles) for word in words]
        moved = next((new + words[len(old) :] for old, new in self.moved if words[: len(old)] == old), words)
        module, arguments = (moved[1], moved[2:]) if moved[0] == "-m" else ("signsplice", moved)
        if own_process:
            words = [sys.executable, "-m", module, *arguments]
            process = subprocess.run(words, capture_output=True, text=True, check=False)
            status, output, errors = f"{process.returncode}", process.stdout, process.stderr
        else:
            status, output, errors = run_here(module, arguments)
        Path(f"{name}.txt").write_text(f"status {status}\n{output}{errors}")
        return output

    def write_inputs(self, name: str) -> None:
        """Writes words that ship, and the same on other rigs, in other units, at other rates, with stray frames,
        broken.
        """
        import numpy as np

        import signsplice as ss

        for folder in ("in/words", "in/broken", "synth/images", "paper/out"):
            Path(folder).mkdir(parents=True)
        words = import_name("shipped")()
        clips = {gloss: words.clip(gloss) for gloss in WORDS}
        for gloss, clip in clips.items():
            ss.save(clip, f"in/{gloss}.bvh")
            ss.save(clip, f"in/words/{gloss}.bvh")
        rig = clips["HELLO"].skeleton

        def variant(file: str, gloss: str, skeleton: Any = rig, scale: float = 1.0, fps: float = 30.0) -> None:
            clip = clips[gloss]
            ss.save(ss.Clip(skeleton, clip.local_rotations, clip.root_positions * scale, fps, gloss), f"in/{file}.bvh")

        plain = [joint.split(":")[-1] for joint in rig.names]
        longer = np.array([1.25 if "Arm" in joint or joint.endswith("Hand") else 1.0 for joint in plain])
        ends = tuple(replace(end, offset=np.asarray(end.offset) * 0.01) for end in rig.end_sites)
        unknown = {joint: f"b{n:02d}" for n, joint in enumerate(rig.names)}
        variant("metres", "DEAF", ss.Skeleton(tuple(plain), rig.parents, rig.offsets * 0.01, ends), 0.01)
        variant("long-arms", "DEAF", ss.Skeleton(rig.names, rig.parents, rig.offsets * longer[:, None], rig.end_sites))
        variant("unknown", "NAME", ss.Skeleton(tuple(unknown.values()), rig.parents, rig.offsets, rig.end_sites))
        variant("fast", "MOTHER", fps=60.0)
        variant("slow", "BOOK", fps=24.0)
        turned = np.array(clips["SIGN"].local_rotations)
        turned[:4] = [0.0, 0.0, 0.0, 1.0]
        ss.save(ss.Clip(rig, turned, clips["SIGN"].root_positions, 30.0, "SIGN"), "in/stray.bvh")
        roles = json.loads(self.call("in/inspected", ["inspect", "in/HELLO.bvh", "--json"]))["roles"]
        Path("in/roles.json").write_text(json.dumps({role: unknown[joint] for role, joint in roles.items()}))
        Path("in/lines.txt").write_text("HELLO I DEAF\nMY NAME fs-ANNA\nI LOVE YOU, friend!\nHELLO XYZZY\n")
        Path("in/page.md").write_text("<!-- measured: begin -->\n<!-- measured: end -->\n")
        Path("in/broken/BAD.bvh").write_text(Path("in/SIGN.bvh").read_text()[:-300])
        shutil.copy("in/I.bvh", "in/broken/I.bvh")
        for file in PAPER_FILES:
            shutil.copy(Path(self.paper) / file, "paper/out")

    def write_avatars(self, name: str) -> None:
        """Writes avatars by the tests' helper of the checkout: VRM 1.0, VRM 0.x and a plain .glb."""
        sys.path.append(f"{self.checkout}/tests")
        helper = importlib.import_module("avatars")
        forms = {"broad.vrm": ("broad", "1.0"), "narrow.vrm": ("narrow", "0.x"), "big.glb": ("big head", "")}
        for file, (body, form) in forms.items():
            avatar = helper.body(body)
            helper.write(Path("in") / file, avatar, helper.tubes(avatar), form)


def run_here(module: str, arguments: list[str]) -> tuple[str, str, str]:
    """Returns exit status, standard output and error of ``python -m MODULE ARGUMENTS``, without its start."""
    output, errors, status, old_arguments = io.StringIO(), io.StringIO(), "0", sys.argv
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            sys.argv = [module, *arguments]
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        except SystemExit as stop:
            status = f"{stop.code or 0}"
        finally:
            sys.argv = old_arguments
    return status, output.getvalue(), errors.getvalue()


def hash_motion(clip: Any) -> str:
    """Returns the hash of a clip's numbers."""
    arrays = (clip.local_rotations, clip.root_positions, *(() if clip.translations is None else (clip.translations,)))
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def write_result(name: str, result: Any) -> None:
    """Writes the report of a splice's result, and the hash of its clip."""
    Path(f"{name}.json").write_text(json.dumps([import_name("describe")(result), hash_motion(result.clip)], indent=1))


def read_words(text: str) -> list[Any]:
    """Returns the words of a typed line, each with whether it begins another spelled word; none is held at a mark."""
    words = import_name("shipped")()
    tokens = import_name("parse")(text, words)
    return [import_name("Word")(words.clip(gloss), k == 0) for token in tokens for k, gloss in enumerate(token.glosses)]


def python_splices(name: str) -> None:
    """Writes outputs of ``splice``, of many sentences at once, and of ``inbetween``."""
    import signsplice as ss

    for n, options in enumerate(OPTIONS):
        chosen, sentences = ss.SpliceOptions(**options), [read_words(line) for line in LINES]
        write_result(f"python/splice-{n}", ss.splice(sentences[n % 4], chosen))
        for row, result in enumerate(import_name("splice_many")(sentences, chosen)):
            write_result(f"python/many-{n}-{row}", result)
    write_result("python/inbetween", ss.inbetween(ss.load("in/NAME.bvh"), [(20, 26), (40, 48)]))


def python_streams(name: str) -> None:
    """Writes the pieces of streams, and of words that arrive: spans, seams, warnings and hashes of the frames."""
    import signsplice as ss

    def write(file: str, pieces: list[Any]) -> None:
        rows = (
            [asdict(p.span), p.seam and asdict(p.seam), p.warnings, len(p.clip), hash_motion(p.clip)] for p in pieces
        )
        Path(f"python/{file}.txt").write_text("".join(json.dumps(row, default=list) + "\n" for row in rows))

    for n, options in enumerate(OPTIONS):
        for row, text in enumerate(LINES):
            write(f"stream-{n}-{row}", list(ss.stream(read_words(text), ss.SpliceOptions(**options))))
    stream = import_name("Stream")()
    pieces = [piece for gloss in LINES[0].split() for piece in stream.push(import_name("shipped")().clip(gloss))]
    write("stream-pushed", pieces + stream.end())


def python_bodies(name: str) -> None:
    """Writes outputs of ``retarget`` onto a clip, a skeleton and an avatar, and the warnings of ``read_avatar``."""
    import signsplice as ss

    target, avatar = ss.load("in/long-arms.bvh"), ss.read_avatar("in/narrow.vrm")
    bodies = (("clip", "NAME", target), ("skeleton", "MOTHER", target.skeleton), ("avatar", "BOOK", avatar))
    for file, source, body in bodies:
        fitted = ss.retarget(ss.load(f"in/{source}.bvh"), body)
        lines = [hash_motion(fitted.clip), *fitted.warnings, *avatar.warnings]
        lines += [json.dumps(asdict(contact), default=list) for contact in fitted.contacts]
        Path(f"python/retarget-{file}.txt").write_text("\n".join(lines) + "\n")


def serve(name: str) -> None:
    """Writes answers of the service, in its own process, and the messages of a stream."""
    words = [sys.executable, "-m", "signsplice", "serve", "--workers", "1", "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as service:
        assert service.stdout is not None
        try:
            line = service.stdout.readline()
            address = line[line.index("http://") :].split()[0].rstrip("/")
            write_answers(address)
            write_stream(address)
        finally:
            service.send_signal(signal.SIGINT)


def write_answers(address: str) -> None:
    """Writes the answers of the service at an address, and the files in them."""
    part = '--0\r\nContent-Disposition: form-data; name="{}"\r\n\r\n{}\r\n'
    files = {file: Path(f"in/{file}").read_text() for file in ("I.bvh", "metres.bvh")}
    parts = [part.format(f'files"; filename="{file}', text) for file, text in files.items()]
    parts += [part.format("options", '{"formats": ["bvh", "glb"], "tempo": "natural"}'), "--0--\r\n"]
    sentence = {"glosses": ["HELLO", "fs-ANNA", "I LOVE YOU"], "formats": ["bvh", "glb", "vrma"], "tempo": "natural"}
    requests = {
        "sentence": ("/v1/sentence", json.dumps(sentence), "application/json"),
        "file": ("/v1/sentence?file=bvh", '{"glosses": ["HELLO", "DEAF"]}', "application/json"),
        "unknown": ("/v1/sentence", '{"glosses": ["HELO"], "spell": false}', "application/json"),
        "splice": ("/v1/splice", "".join(parts), "multipart/form-data; boundary=0"),
        "lexicon": ("/v1/lexicon?search=GO&limit=20", "", ""),
        "methods": ("/v1/methods", "", ""),
    }
    for name, (route, body, kind) in requests.items():
        request = urllib.request.Request(address + route, body.encode() or None, {"Content-Type": kind} if kind else {})
        try:
            with urllib.request.urlopen(request, timeout=120) as reply:
                content = reply.read()
        except urllib.error.HTTPError as error:
            content = error.read()
        Path(f"serve/{name}.json").write_bytes(content)
        for suffix, file in json.loads(content).get("files", {}).items() if name in ("sentence", "splice") else ():
            Path(f"serve/{name}.{suffix}").write_bytes(base64.b64decode(file or ""))


def write_stream(address: str) -> None:
    """Writes the messages of the service's stream."""
    from websockets.sync.client import connect

    words = [{"type": "word", "gloss": gloss} for gloss in ("HELLO", "fs-ANNA", "DEAF")]
    with connect(address.replace("http", "ws", 1) + "/v1/stream", max_size=None) as stream:
        for request in ({"type": "open", "paced": False}, *words, {"type": "end"}):
            stream.send(json.dumps(request))
        lines = [m if isinstance(m, str) else f"{len(m)} {hashlib.sha256(m).hexdigest()}" for m in stream]
    Path("serve/stream.txt").write_text("\n".join(lines) + "\n")


def describe_machine() -> str:
    """Returns the kind of processor and the libraries, for the list's first line."""
    info = Path("/proc/cpuinfo")
    rows = dict(re.findall(r"^([\w ]+?)\s*: (.*)$", info.read_text(), re.MULTILINE)) if info.exists() else {}
    kind = ", ".join(f"{key} {rows[key]}" for key in ("model name", "cpu family", "model") if key in rows)
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "onnxruntime"))
    return f"{kind or 'processor unknown'}; Python {sys.version.split()[0]}, {libraries}"


def make_inside(options: argparse.Namespace) -> int:
    """Runs ``make`` in the interpreter whose installation makes the outputs, in the folder."""
    maker = Maker(options.checkout, options.paper, options.bundles, options.moved)
    maker.make()
    import signsplice

    places = {
        str(Path(signsplice.__file__).parent): "PACKAGE",
        options.bundles: "BUNDLES",
        options.checkout: "CHECKOUT",
    }
    lines = [f"# {describe_machine()}; name, bytes, sha256"]
    for path in sorted(path for path in Path().rglob("*") if path.is_file()):
        content = normalise(path.as_posix(), path.read_bytes(), places)
        path.write_bytes(content)
        lines.append(f"{path.as_posix()}\t{len(content)}\t{hashlib.sha256(content).hexdigest()}")
    Path("outputs.tsv").write_text("\n".join(lines) + "\n")
    slowest = sorted(maker.seconds, key=lambda name: -maker.seconds[name])[:6]
    print(f"{len(lines) - 1} files of {len(maker.seconds)} outputs in {sum(maker.seconds.values()):.0f} s; longest:")
    print(", ".join(f"{name} {maker.seconds[name]:.0f} s" for name in slowest))
    return 0


def make(options: argparse.Namespace) -> int:
    """Makes the folder of outputs with the interpreter that is named."""
    folder, checkout = Path(options.output).resolve(), Path(options.checkout).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        sys.exit(f"error: {folder}: is not empty")
    paper = Path(options.paper or checkout / "docs" / "paper").resolve()
    bundles = Path(options.bundles or checkout / "docs" / "paper" / "bundles").resolve()
    paths = [str(Path(path).resolve()) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    env = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0", "PYTHONPATH": os.pathsep.join(paths)}
    python = os.path.abspath(shutil.which(options.python) or options.python)
    words = [python, __file__, "inside", checkout, paper, bundles, *options.moved]
    return subprocess.run([str(word) for word in words], cwd=folder, env=env, check=False).returncode


def compare(options: argparse.Namespace) -> int:
    """Prints the differences between two lists; returns 1 if there are any."""
    (first, *old_rows), (second, *new_rows) = (
        Path(file).read_text().splitlines() for file in (options.old, options.new)
    )
    if first != second:
        print(f"made by {first}\n    and {second}")
    old, new = ({row.split("\t")[0]: row.split("\t")[1:] for row in rows} for rows in (old_rows, new_rows))
    changed = [name for name in sorted({*old, *new}) if old.get(name) != new.get(name)]
    for name in changed:
        change = "missing" if name not in new else "new" if name not in old else "differs"
        print(f"{change:8} {name}: {' -> '.join(rows[name][0] for rows in (old, new) if name in rows)} bytes")
    print(f"{len(old)} and {len(new)} files, {len({*old, *new}) - len(changed)} of them the same")
    return int(bool(changed))


def main() -> int:
    """Runs the command that is named; returns its exit status."""
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers(required=True)
    maker = commands.add_parser("make", help="make a folder of outputs and its list, outputs.tsv")
    maker.add_argument("--python", default=sys.executable, help="interpreter that has signsplice")
    maker.add_argument("-o", "--output", required=True, metavar="FOLDER", help="new or empty folder")
    maker.add_argument("--checkout", default=str(HERE.parents[1]), help="sources, with tests/avatars.py and docs/paper")
    maker.add_argument("--paper", help="folder of the paper's results.json (CHECKOUT/docs/paper)")
    maker.add_argument("--bundles", help="folder of the paper's trained systems (CHECKOUT/docs/paper/bundles)")
    moved_help = "a command that moved, as 'paper=-m signsplice_paper'; repeatable, the first match counts"
    maker.add_argument("--command", dest="moved", action="append", default=[], metavar="OLD=NEW", help=moved_help)
    maker.set_defaults(run=make)
    comparer = commands.add_parser("compare", help="print what differs between two lists")
    comparer.add_argument("old", metavar="OLD.tsv")
    comparer.add_argument("new", metavar="NEW.tsv")
    comparer.set_defaults(run=compare)
    inner = commands.add_parser("inside")
    for argument in ("checkout", "paper", "bundles"):
        inner.add_argument(argument)
    inner.add_argument("moved", nargs="*")
    inner.set_defaults(run=make_inside)
    options = parser.parse_args()
    return int(options.run(options))


if __name__ == "__main__":
    sys.exit(main())
