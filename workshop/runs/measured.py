"""Makes the pages of workshop/docs/measured: makes the measurements of a page, then writes it from the stored figures.

`make measured` runs it for every page but `scale`, `make measured-PAGE` for one. Each finished measurement is stored in
out/measured under the tree of its sources, so that the same call continues after an interruption.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from signsplice_workshop.measure.bodies import FITTED, ROTATIONS
from signsplice_workshop.measure.measures import format_csv, format_measures, format_table
from signsplice_workshop.measure.person import MEASURES
from signsplice_workshop.measure.seams import STITCHER

Figures = Mapping[str, Any]
"""A stored measurement: `rows`, `signature`, and `made_with` if it was recorded."""

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "workshop" / "docs" / "measured"
DEFAULT = "learned + learned, collision avoidance"
NATURAL = f"{DEFAULT}, natural tempo"
RESTS = {"hanging": "joins", "folded": "joins-folded", "bent": "joins-bent", "low": "joins-low"}
TAKES = {"long-take-metres": "long_take_metres.bvh", "isl-thanks": "isl_thanks.bvh"}
LEARNED_FRAMES = "0:315"
"""Frames of the take with which the corpus is compared; the others are held out."""


@dataclass(frozen=True)
class Page:
    """One page.

    figures: name of a JSON file -> words of the command that prints it; {real} is a folder.
    small: the same words for a quick try.
    write: makes the page's lines and the rows of its CSV file, from all figures by name.
    real: the files of real signing that it needs.
    """

    figures: Mapping[str, str]
    small: Mapping[str, str]
    write: Callable[[Mapping[str, Figures]], tuple[list[str], list[Sequence[object]]]]
    real: Sequence[str] = ()


def format_versions(figures: Iterable[Figures]) -> list[str]:
    """Returns the line that names the versions that made some figures."""
    stamps = [f["made_with"] for f in figures if "made_with" in f]
    if not stamps:
        return ["Made by an earlier version, whose commit was not recorded ([evaluation.md](../evaluation.md))."]
    kinds = list(dict.fromkeys((s["commit"], s["version"], s["n_words"], s["words"], s["bundle"]) for s in stamps))
    return [
        f"Made at commit `{commit}` (version {number}): the {n} words that ship (sha256 `{words[:12]}`), "
        f"networks `{bundle[:12]}`."
        for commit, number, n, words, bundle in kinds
    ]


def wrap_prose(text: str) -> list[str]:
    """Returns the lines of a paragraph, or of a list, each of whose items begins a line with a hyphen."""
    items = [" ".join(item.split()) for item in re.split(r"^\s*- ", text, flags=re.MULTILINE)]
    if len(items) == 1:
        return textwrap.wrap(items[0], 118, break_on_hyphens=False)
    return [
        line
        for item in items[1:]
        for line in textwrap.wrap(f"- {item}", 118, subsequent_indent="  ", break_on_hyphens=False)
    ]


def format_percent(fraction: float, digits: int = 1) -> str:
    """Returns a fraction in %."""
    return f"{100 * fraction:.{digits}f} %"


def format_range(values: Iterable[float], form: str = ".2f") -> str:
    """Returns least to greatest of some values; one figure if both look the same."""
    low, high = (format(f(list_), form) for list_ in [list(values)] for f in (min, max))
    return low if low == high else f"{low} to {high}"


def index_rows(figures: Figures, key: str) -> dict[Any, Mapping[str, Any]]:
    """Returns the rows of figures by one of their fields."""
    return {row[key]: row for row in figures["rows"]}


def format_dips(row: Mapping[str, Any], key: str = "dips") -> str:
    """Returns the seams of a row that dip and that dip deep, in %; "-" if they were not measured."""
    fractions = [row[name] for name in (key, f"deep_{key}") if row.get(name) is not None]
    return "-" if len(fractions) < 2 else "/".join(f"{100 * fraction:.0f}" for fraction in fractions)


FACES = ("face_jumps", "half_blinks")


def format_faces(row: Figures) -> str:
    """Returns the percentages of seams in which a face jumps, and in which it blinks by half."""
    return "/".join(f"{100 * row[key]:.1f}" if row.get(key) is not None else "-" for key in FACES)


def format_worst_faces(by_name: Mapping[str, Figures], method: str) -> str:
    """Returns the largest percentages of ``format_faces`` of a method, over all rests."""
    rows = [index_rows(by_name[name], "method").get(method, {}) for name in RESTS.values()]
    return format_faces(
        {key: max((row[key] for row in rows if row.get(key) is not None), default=None) for key in FACES}
    )


def make_seams_page(by_name: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Returns the page of every method at seams, and of the default with every rest."""
    rows = index_rows(by_name["joins"], "method")
    ours, n = rows[DEFAULT], rows[DEFAULT]["n_joins"]
    classical = [r for name, r in rows.items() if "learned" not in name and name not in (STITCHER, "ends + hermite")]
    best = min(classical, key=lambda r: float(r["velocity_jump"]))
    deep = format_range(
        [100 * r["deep"] for r in classical if "hold" not in r["method"] and "avoid" not in r["method"]], ".0f"
    )
    lines = [
        *wrap_prose(f"""
            - At the ends of a default transition the wrists' velocity changes by {ours["velocity_jump"]:.2f} m/s, the
              median of {n} seams; the least of a classical method that cuts is {best["velocity_jump"]:.2f}
              (`{best["method"]}`).
            - The default keeps all movements of both signs in {format_percent(ours["whole"])} of the seams, and its
              transition takes {ours["seconds"]:.2f} s.
            - Seams of the default in which a hand sinks by over 3/6 cm: {format_dips(ours)} %; from stroke to stroke
              {format_dips(ours, "stroke_dips")} %; at natural tempo {format_dips(rows.get(NATURAL, {}))} %.
            - {format_percent(ours["deep"])} of the default's transitions lead a hand more than 5 mm into the body;
              {deep} % of the classical ones without collision avoidance (`hold` apart, which does not move).
            - Seams in which a face jumps or blinks by half, with random faces: {format_faces(ours)} % by default,
              {format_faces(rows.get(NATURAL, {}))} % at natural tempo, {format_faces(rows.get(STITCHER, {}))} % by the
              stitcher; with other rests up to {format_worst_faces(by_name, DEFAULT)} and
              {format_worst_faces(by_name, NATURAL)} % by default and at natural tempo.
        """),
        "",
        *format_table(
            (
                *("method", "seconds", "velocity jump, m/s", "jerk ratio", "arms down, frames", "strokes whole"),
                *("deep", "dips, %"),
            ),
            [
                (
                    *(name, f"{r['seconds']:.2f}", f"{r['velocity_jump']:.2f}", f"{r['jerk_ratio']:.2f}"),
                    *(
                        f"{r['arms_down']:.1f}",
                        format_percent(r["whole"], 0),
                        "-" if r["deep"] is None else format_percent(r["deep"]),
                        format_dips(r),
                    ),
                )
                for name, r in rows.items()
            ],
        ),
        "",
        *wrap_prose("""
            The first name is the cutter, the second the transition. Seconds, jumps and jerk are medians;
            arms down: kept frames between the strokes in which both arms hang, mean; deep: a hand more than
            5 mm in the body; dips: the
            strong wrist sinks by over 3/6 cm.
            The stitcher is that of spoken-to-signed 0.4.0, rebuilt from its description
            (`measure/seams.py`).
        """),
        "",
        "## Signers who rest in other ways",
        "",
        *wrap_prose("""
            The same words, whose signer rests with one hand on the other before the belly (folded), with forearms
            before the waist (bent) or with hands that meet low. Back at rest: kept frames between the strokes with
            neither hand raised.
        """),
        "",
        *format_table(
            ("rest", "method", "back at rest, frames", "strokes whole", "velocity jump, m/s", "jerk ratio", "dips"),
            [
                (
                    *(rest, method, f"{r['arms_down']:.1f}", format_percent(r["whole"], 0)),
                    *(f"{r['velocity_jump']:.2f}", f"{r['jerk_ratio']:.2f}", format_dips(r)),
                )
                for rest, name in RESTS.items()
                for method in ("pose-velocity + hermite", DEFAULT)
                for r in [index_rows(by_name[name], "method")[method]]
            ],
        ),
    ]
    table = [(rest, *row.values()) for rest, name in RESTS.items() for row in by_name[name]["rows"]]
    return lines, [("rest", *by_name["joins"]["rows"][0]), *table]


def make_hidden_frames_page(by_name: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Returns the page of the learned transition over Hermite's, by clip and rate, and every method's error on the
    take.
    """
    ratios = {}
    for name, figures in by_name.items():
        rows = {(r["transition"], r["n_frames"]): r for r in figures["rows"]}
        lengths = sorted({n for _, n in rows})
        ratios[name] = [rows["learned", n]["position_error"] / rows["hermite", n]["position_error"] for n in lengths]
    take = {(r["transition"], r["n_frames"]): r for r in by_name["hidden-long-take-metres-30"]["rows"]}
    motion = [
        format_range([r["motion_ratio"] for (t, _), r in take.items() if t == name]) for name in ("learned", "hermite")
    ]
    fps = {name: name.rpartition("-")[2] for name in by_name}
    long, keyed = ([name for name in by_name if take_name in name] for take_name in TAKES)

    def by_rate(names: Sequence[str]) -> str:
        return ", ".join(f"{format_range(ratios[name])} ({fps[name]} fps)" for name in names)

    lines = [
        *wrap_prose(f"""
            - On a captured take the learned transition has {by_rate(long)} of Hermite's error; on a clip that a program
              interpolated between keys {by_rate(keyed)}.
            - Its fingertips make {motion[0]} of the true motion at 30 fps; Hermite's {motion[1]}.
        """),
        "",
        "Learned over Hermite, error by number of hidden frames:",
        "",
        *format_table(
            ("clip, fps", *lengths),
            [
                (f"{TAKES[name.removeprefix('hidden-').rpartition('-')[0]]}, {fps[name]}", *(f"{x:.2f}" for x in row))
                for name, row in ratios.items()
            ],
        ),
        "",
        "Error of every method on the take at 30 fps, thousandths of the arm's length:",
        "",
        *format_table(
            ("transition", *lengths),
            [
                (name, *(f"{take[name, n]['position_error']:.1f}" for n in lengths))
                for name in dict.fromkeys(t for t, _ in take)
            ],
        ),
        "",
        *wrap_prose("""
            Frames are hidden from a clip; every transition fills them and sees 8 frames on either side. The error is
            the mean distance of elbows, wrists and fingers from the truth, relative to the root. Random gaps hide
            strokes as well as transitions, so they are harder than the gaps between signs: read the order of the
            methods. Fingers, trunk and head of `learned` are those of `hermite`; `learned` runs with collision
            avoidance, the others without. The clips, of upf-gti/SignON-editor (Apache-2.0), are not part of this
            project; the keyed one is no measure of real motion. Errors of hands, fingers and trunk, motion ratio,
            velocity jump and depth are in the CSV file.
        """),
    ]
    table = [
        (fps[name], name.removeprefix("hidden-"), *row.values()) for name in by_name for row in by_name[name]["rows"]
    ]
    return lines, [("fps", "clip", *next(iter(by_name.values()))["rows"][0]), *table]


def make_bodies_page(by_name: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Returns the page of what words keep on other bodies, rotations alone and fitted."""
    rows = {(r["body"], r["method"]): r for r in by_name["bodies-150"]["rows"]}
    names = list(dict.fromkeys(body for body, _ in rows))

    def kept(method: str, held_out: bool, key: str = "kept_frames") -> str:
        return format_range(
            [100 * r[key] for (_, m), r in rows.items() if m == method and r["held_out"] == held_out], ".1f"
        )

    def cells(body: str) -> list[str]:
        plain, fit = rows[body, ROTATIONS], rows[body, FITTED]
        times = "-" if fit["time_ratio"] is None else f"{fit['time_ratio']:.1f}"
        return [
            *(f"{body}, kept aside" if fit["held_out"] else body,),
            *(f"{100 * plain['kept_frames']:.1f}", f"{100 * fit['kept_frames']:.1f}", f"{100 * fit['kept_clear']:.1f}"),
            *(f"{1e3 * plain['hand_depth']:.0f}", f"{1e3 * fit['hand_depth']:.0f}", times),
        ]

    usual, aside = (next(r for r in rows.values() if r["held_out"] == held_out) for held_out in (False, True))
    lines = [
        *wrap_prose(f"""
            - Fitted, words keep {kept(FITTED, False)} % of the frames with a touch; with rotations copied
              {kept(ROTATIONS, False)} %.
            - On bodies and words on which no choice was made: {kept(FITTED, True)} % against {kept(ROTATIONS, True)} %.
            - Of touching pairs that do not lie deep at the source, {kept(FITTED, False, "kept_clear")} % are kept.
        """),
        "",
        *wrap_prose("""
            % of touching frames whose nearest pair keeps its distance within 5 mm; the same of pairs that lie less than
            2 mm deep at the source; the greatest depth of a hand beyond the source's, mm; processor time over that of
            rotations:
        """),
        "",
        *format_table(
            ("body", "rotations", "fitted", "clear pairs, fitted", "depth, rotations", "depth, fitted", "times"),
            [cells(body) for body in names],
        ),
        "",
        *wrap_prose(f"""
            {usual["n_words"]} words with {usual["n_touching"]} touching frames; kept aside {aside["n_words"]} words
            with {aside["n_touching"]}. The same of 40 words, and all other columns (places, directions, smoothness,
            time), are in the CSV file.
        """),
        "",
        "![Eight words at the frame in which most touches: the source, then on five bodies](../images/bodies.png)",
        "",
        *wrap_prose("""
            Words that ship are brought to other bodies in two ways: their rotations copied, and fitted
            (`body.retarget.fit_body`). The fit's weights were chosen on the bodies narrow, broad, child, chibi and long
            arms and on 17 words (`evaluation.bodies.TUNED_ON`). The bodies stout, youth and lanky and a third of the
            words, by the hash of their names, are kept aside. All words are of one synthetic signer. Bodies are the
            words' own rig with bones stretched and capsules shaped anew (`measure/bodies.py`); small head
            and belly differ in skin alone.
        """),
    ]
    table = [
        (name, *(value for key, value in row.items() if key != "worst"))
        for name in by_name
        for row in by_name[name]["rows"]
    ]
    head = [key for key in by_name["bodies-150"]["rows"][0] if key != "worst"]
    return lines, [("figures", *head), *table]


def make_tempo_page(by_name: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Returns the page of signs at running tempo beside the same as recorded."""
    rows = by_name["tempo"]["rows"]
    before, after = ([r for r in rows if r["tempo"] == name] for name in ("citation", "natural"))
    lost = [max(0.0, b["whole"] - a["whole"]) for b, a in zip(before, after, strict=True)]
    least = min((r["contacts"] for r in after if r["contacts"] is not None), default=None)
    lines = [
        *wrap_prose(f"""
            - As recorded, a sign takes {format_range(r["ratio"] for r in before)} times the 0.70 s of running signing;
              with `--tempo natural` {format_range(r["ratio"] for r in after)} times.
            - {format_percent(max(lost), 0) if max(lost) else "None"} of the strokes that `citation` keeps is lost;
              {"no word has a contact" if least is None else f"{format_percent(1 - least, 0)} of the contacts at most"}.
        """),
        "",
        *format_table(
            (
                "words",
                "tempo",
                "of running tempo",
                "sign, s",
                "transition, s",
                "jerk ratio",
                "velocity jump, m/s",
                "whole",
            ),
            [
                (
                    *(r["words"], r["tempo"], f"{r['ratio']:.2f}", f"{r['sign_seconds']:.2f}"),
                    *(f"{r['transition_seconds']:.2f}", f"{r['jerk_ratio']:.2f}", f"{r['velocity_jump']:.2f}"),
                    format_percent(r["whole"], 0),
                )
                for r in rows
            ],
        ),
        "",
        *wrap_prose(f"""
            {rows[0]["n_signs"]} words that ship and as many others by each of three other signers, and those that
            ship again, slowed and held longer or with noise; in sentences of seven, first and last left out. Jerk is
            over the recorded sign's, both scaled to one duration. What follows from this is in
            [evaluation.md](../evaluation.md).
        """),
    ]
    return lines, []


def make_person_page(by_name: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Returns the page of idle hands, head, trunk and face in sentences."""
    rows = [SimpleNamespace(**row) for row in by_name["person"]["rows"]]
    lines = [
        *wrap_prose(f"""
            - A hand drops to hang while the other signs {format_range((r.drops for r in rows), ".1f")} times a minute;
              in captured signing 2.8 times.
            - The head turns by {format_range((r.head_spread for r in rows), ".1f")} degrees rms, people's by 9 to 12,
              and at most at {max(r.head_peak for r in rows):.0f} degrees/s in seams of words that do not move it.
            - The mouth moves in {100 * max(r.mouth for r in rows):.0f} % of the frames.
            - A seam with an idle hand takes {format_range(r.idle_seam_s for r in rows)} s, another
              {format_range(r.other_seam_s for r in rows)} s.
        """),
        "",
        *format_measures(MEASURES, rows),
        "",
        *wrap_prose("""
            Seven sentences of seven words of each kind. What counts as idle, raised and hanging, and the figures of
            captures, are in `measure/person.py`; `signsplice evaluate person --clips FILE` measures a recording.
        """),
    ]
    return lines, []


def make_bench_page(by_name: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Returns the page of the speed of every part."""
    parts = {name: part for name, part in by_name["bench"].items() if isinstance(part, dict) and name != "made_with"}
    learned, stream = parts["learned"], parts["stream"]
    lines = [
        *wrap_prose(f"""
            - A seam of two words of a lexicon takes {learned["seam, p50, ms"]:.1f} ms of processor time by the default
              (99 %: {learned["seam, p99, ms"]:.1f} ms), of ten words {learned["seam of ten words, ms"]:.1f} ms each.
            - The first piece of a stream is there after {stream["first piece, ms"]:.1f} ms.
        """),
        "",
        *format_table(
            ("part", "what", "figure"),
            [(name, what, f"{value:.4g}") for name, part in parts.items() for what, value in part.items()],
        ),
        "",
        *wrap_prose(f"""
            Medians of {by_name["bench"]["repeats"]} runs on one thread, clips of {by_name["bench"]["joints"]} joints.
            How each is taken, and the aims, are in [speed.md](../../../docs/speed.md).
        """),
    ]
    return lines, []


TITLES = {
    "seams": "Seams of words recorded apart",
    "hidden-frames": "Hidden frames",
    "bodies": "Words on other bodies",
    "tempo": "Running tempo",
    "person": "The rest of the person",
    "bench": "Speed",
}
PAGES = {
    "seams": Page(
        {name: f"evaluate seams 500 --rest {rest} --json" for rest, name in RESTS.items()},
        {name: f"evaluate seams 3 --rest {rest} --json" for rest, name in RESTS.items()},
        make_seams_page,
    ),
    "hidden-frames": Page(
        figures := {
            f"hidden-{name}-{fps}": f"evaluate clips {{real}}/{file}{rate} --json"
            for name, file in TAKES.items()
            for fps, rate in ((30, ""), (24, " --fps 24"))
        },
        figures,
        make_hidden_frames_page,
        tuple(TAKES.values()),
    ),
    "bodies": Page(
        {name: f"evaluate bodies {n} --json" for name, n in (("bodies-150", 150), ("bodies", 40))},
        dict.fromkeys(("bodies-150", "bodies"), "evaluate bodies 6 --json"),
        make_bodies_page,
    ),
    "tempo": Page({"tempo": "evaluate tempo 40 --json"}, {"tempo": "evaluate tempo 7 --json"}, make_tempo_page),
    "person": Page({"person": "evaluate person 7 --json"}, {"person": "evaluate person 1 --json"}, make_person_page),
    "bench": Page({"bench": "bench --repeats 15 --json"}, {"bench": "bench --repeats 3 --json"}, make_bench_page),
}


def make_page(name: str, folder: Path = DOCS) -> tuple[str, str]:
    """Returns a page and its CSV file, empty if it has none, from the figures in a folder."""
    page = PAGES[name]
    by_name = {file: json.loads((folder / f"{file}.json").read_text(encoding="utf-8")) for file in page.figures}
    lines, table = page.write(by_name)
    files = [f"[{file}.json]({file}.json)" for file in by_name] + ([f"[{name}.csv]({name}.csv)"] if table else [])
    tail = [
        "",
        *format_versions(by_name.values()),
        "Figures, with their signatures:",
        ",\n".join(files) + ". Made by",
        "",
    ]
    tail += [f"    signsplice {words.format(real='DIR')}" for words in page.figures.values()]
    tail += ["", f"all together by `make measured-{name}`."]
    return "\n".join([f"# {TITLES[name]}", "", *lines, *tail]) + "\n", format_csv(*_round_table(table)) if table else ""


def _round_table(table: Sequence[Sequence[object]]) -> tuple[Sequence[object], list[list[object]]]:
    """Returns the head and the rows of a table, with numbers of five digits."""
    rows = [[f"{cell:.5g}" if isinstance(cell, float) else cell for cell in row] for row in table[1:]]
    return table[0], rows


def run(words: Sequence[str], **options: Any) -> subprocess.CompletedProcess[str]:
    """Runs the command line on one thread."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    call = [sys.executable, "-m", "signsplice", *words]
    return subprocess.run(call, check=True, text=True, env=environment, cwd=ROOT, **options)


def git(*words: str) -> str:
    """Returns the output of git."""
    return subprocess.run(["git", *words], check=True, capture_output=True, text=True, cwd=ROOT).stdout.strip()


def stamp() -> dict[str, object]:
    """Returns the versions that make the figures: commit, version, words and networks."""
    from signsplice.bulk.job import hash_of_words
    from signsplice.lexicon import open_shipped_lexicon
    from signsplice.splicing.options import open_learned

    with open_shipped_lexicon() as words:
        n_words = sum(entry.kind == "sign" for entry in words.entries())
        return {
            "commit": git("rev-parse", "HEAD"),
            "version": version("signsplice"),
            "n_words": n_words,
            "words": hash_of_words(words),
            "bundle": open_learned().sha256,
        }


def measure(name: str, words: str, work: Path, real: Path | None) -> dict[str, Any]:
    """Returns the figures of one command, stamped; those of an earlier call with the same sources, if there are any."""
    stored = work / f"{name}.json"
    if not stored.exists():
        print(f"measuring {name}", file=sys.stderr, flush=True)
        stamped = {"made_with": stamp()}
        call = [word.format(real=real) for word in words.split()]
        figures = json.loads(run(call, stdout=subprocess.PIPE).stdout)
        stored.with_suffix(".part").write_text(json.dumps({**stamped, **figures}, indent=2) + "\n", encoding="utf-8")
        stored.with_suffix(".part").replace(stored)
    return dict(json.loads(stored.read_text(encoding="utf-8")))


def make_corpus(work: Path) -> Path:
    """Makes the corpus of pairs of these sources, and returns its folder."""
    small = ("--words", "4", "--other-signer", "4") if work.name.endswith("small") else ()
    if not (work / "pairs" / "corpus.json").exists():
        run(["synth", "pairs", "-o", str(work / "pairs"), *small], stdout=subprocess.DEVNULL)
    return work / "pairs"


def write_corpus_page(work: Path, real: Path, docs: Path) -> None:
    """Writes the page of the corpus: `evaluate corpus`, with the captured take alone, and a line that names the
    versions.
    """
    page, images = docs / "corpus.md", docs.parent / "images"
    if docs != DOCS:
        shutil.copy(DOCS / page.name, page)
        images.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        take = TAKES["long-take-metres"]
        (Path(folder) / take).symlink_to((real / take).resolve())
        call = ["evaluate", "corpus", str(make_corpus(work)), "--page", str(page), "--images", str(images)]
        run([*call, "--real", folder, "--real-frames", LEARNED_FRAMES], stdout=subprocess.DEVNULL)
    lines = format_versions([{"made_with": stamp()}])
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("\nCorpus `", "\n".join(["", *lines, "Corpus `"]), 1), encoding="utf-8")


def write_bulk_page(work: Path, docs: Path) -> None:
    """Writes the page of sentences in bulk."""
    from signsplice.bench import bulk

    figures = measure("scale", "bench bulk --json", work, None)
    (docs / "scale.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    (docs / "scale.md").write_text(bulk.page(figures), encoding="utf-8")


def write_page(name: str, work: Path, real: Path | None, docs: Path, small: bool) -> None:
    """Writes one page, its JSON files and its CSV file."""
    page = PAGES[name]
    for file, words in (page.small if small else page.figures).items():
        figures = measure(file, words, work, real)
        (docs / f"{file}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    if name == "bodies" and not small:
        picture = docs.parent / "images" / "bodies.png"
        run(["evaluate", "bodies", "3", "--picture", str(picture)], stdout=subprocess.DEVNULL)
    text, table = make_page(name, docs)
    (docs / f"{name}.md").write_text(text, encoding="utf-8")
    if table:
        (docs / f"{name}.csv").write_text(table, encoding="utf-8")


def main() -> None:
    """Makes the pages that are named; by default all but `scale`."""
    names = [*PAGES, "corpus", "scale"]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"{', '.join(names)}; default: all but scale")
    parser.add_argument("--real", type=Path, metavar="DIR", help="folder of the clips of real signing")
    parser.add_argument("--small", type=Path, metavar="DIR", help="try the commands on a few words, into this folder")
    parser.add_argument("--from-json", action="store_true", help="write the pages from the figures that are there")
    options = parser.parse_args()
    if unknown := [name for name in options.pages if name not in names]:
        parser.error(f"no page {unknown[0]!r}, expected one of {', '.join(names)}")
    pages = options.pages or names[:-1]
    if options.from_json:
        for name in (name for name in pages if name in PAGES):
            text, table = make_page(name)
            (DOCS / f"{name}.md").write_text(text, encoding="utf-8")
            if table:
                (DOCS / f"{name}.csv").write_text(table, encoding="utf-8")
        return
    if options.small is None and git("status", "--porcelain", "src", "workshop/src"):
        sys.exit("the sources have changes that are not committed, and a page names its commit: commit them first")
    trees = "-".join(git("rev-parse", f"HEAD:{folder}")[:8] for folder in ("src/signsplice", "workshop/src"))
    key = f"{trees}{'-small' if options.small else ''}"
    work, docs = (options.small or ROOT / "out") / "measured" / key, options.small or DOCS
    work.mkdir(parents=True, exist_ok=True)
    for name in pages:
        needed = PAGES[name].real if name in PAGES else (TAKES["long-take-metres"],) if name == "corpus" else ()
        missing = [file for file in needed if options.real is None or not (options.real / file).is_file()]
        if missing:
            print(f"{name}: skipped, needs {' and '.join(missing)}: REAL=DIR names their folder", file=sys.stderr)
        elif name == "corpus":
            write_corpus_page(work, options.real, docs)
        elif name == "scale":
            write_bulk_page(work, docs)
        else:
            write_page(name, work, options.real, docs, options.small is not None)


if __name__ == "__main__":
    main()
