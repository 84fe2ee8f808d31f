"""Makes the pages of workshop/docs/measured: measures what a page needs, then writes the page from the stored figures.

`make measured` runs it for every page but `scale`, `make measured-PAGE` for one. Each finished measurement is kept in
out/measured under the tree of the sources that made it, so that the same call continues after an interruption.
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
from typing import Any

from signsplice_workshop.measure.bodies import FITTED, ROTATIONS
from signsplice_workshop.measure.measures import csv_text, markdown
from signsplice_workshop.measure.seams import STITCHER

Figures = Mapping[str, Any]
"""What a measurement stored: `rows`, `signature`, and `made_with` where it was recorded."""

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "workshop" / "docs" / "measured"
DEFAULT = "learned + learned, collision avoidance"
NATURAL = f"{DEFAULT}, natural tempo"
RESTS = {"hanging": "joins", "folded": "joins-folded", "bent": "joins-bent", "low": "joins-low"}
TAKES = {"long-take-metres": "long_take_metres.bvh", "isl-thanks": "isl_thanks.bvh"}
LEARNED_FRAMES = "0:315"
"""Frames of the take that the corpus is compared with; the others are kept for proof."""


@dataclass(frozen=True)
class Page:
    """One page.

    figures: name of a JSON file -> words of the command that prints it; {real} and {pairs} are folders.
    small: the same words for a quick try.
    write: the page's lines and the rows of its CSV file, of all figures by name.
    real: the file of real signing that it needs.
    """

    figures: Mapping[str, str]
    small: Mapping[str, str]
    write: Callable[[Mapping[str, Figures]], tuple[list[str], list[Sequence[object]]]]
    real: Sequence[str] = ()


def made_with(figures: Iterable[Figures]) -> list[str]:
    """The line that says what made some figures."""
    stamps = [f["made_with"] for f in figures if "made_with" in f]
    if not stamps:
        return ["Made by an earlier version, whose commit was not recorded ([evaluation.md](../evaluation.md))."]
    kinds = list(dict.fromkeys((s["commit"], s["version"], s["n_words"], s["words"], s["bundle"]) for s in stamps))
    return [
        f"Made at commit `{commit}` (version {number}): the {n} words that ship (sha256 `{words[:12]}`), "
        f"networks `{bundle[:12]}`."
        for commit, number, n, words, bundle in kinds
    ]


def prose(text: str) -> list[str]:
    """Lines of a paragraph, or of a list, each of whose items begins a line with a hyphen."""
    items = [" ".join(item.split()) for item in re.split(r"^\s*- ", text, flags=re.MULTILINE)]
    if len(items) == 1:
        return textwrap.wrap(items[0], 118, break_on_hyphens=False)
    return [
        line
        for item in items[1:]
        for line in textwrap.wrap(f"- {item}", 118, subsequent_indent="  ", break_on_hyphens=False)
    ]


def percent(fraction: float, digits: int = 1) -> str:
    """A fraction in %."""
    return f"{100 * fraction:.{digits}f} %"


def span(values: Iterable[float], form: str = ".2f") -> str:
    """Least to greatest of some values; one figure where they are shown alike."""
    low, high = (format(f(list_), form) for list_ in [list(values)] for f in (min, max))
    return low if low == high else f"{low} to {high}"


def of(figures: Figures, key: str) -> dict[Any, Mapping[str, Any]]:
    """The rows of figures by one of their fields."""
    return {row[key]: row for row in figures["rows"]}


def dips(row: Mapping[str, Any], key: str = "dips") -> str:
    """The seams of a row that dip and that dip deep, in %; "-" where they were not measured."""
    both = row.get(key), row.get(f"deep_{key}")
    return "-" if None in both else "/".join(f"{100 * one:.0f}" for one in both)


FACES = ("face_jumps", "half_blinks")


def faces(row: Figures) -> str:
    """Percent of seams in which a face jumps, and in which it blinks by half."""
    return "/".join(f"{100 * row[key]:.1f}" if row.get(key) is not None else "-" for key in FACES)


def worst_faces(found: Mapping[str, Figures], method: str) -> str:
    """The largest of these of a method, over all rests."""
    rows = [of(found[name], "method").get(method, {}) for name in RESTS.values()]
    return faces({key: max((row[key] for row in rows if row.get(key) is not None), default=None) for key in FACES})


def seams(found: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Every method at seams, and the default with every rest."""
    rows = of(found["joins"], "method")
    ours, n = rows[DEFAULT], rows[DEFAULT]["n_joins"]
    classical = [r for name, r in rows.items() if "learned" not in name and name not in (STITCHER, "ends + hermite")]
    best = min(classical, key=lambda r: float(r["velocity_jump"]))
    deep = span([100 * r["deep"] for r in classical if "hold" not in r["method"] and "avoid" not in r["method"]], ".0f")
    lines = [
        *prose(f"""
            - At the ends of a default transition the wrists' velocity changes by {ours["velocity_jump"]:.2f} m/s, the
              median of {n} seams; the least of a classical method that cuts is {best["velocity_jump"]:.2f}
              (`{best["method"]}`).
            - The default keeps all movements of both signs in {percent(ours["whole"])} of the seams, and its transition
              takes {ours["seconds"]:.2f} s.
            - Seams of the default in which a hand sinks by over 3/6 cm: {dips(ours)} %; from stroke to stroke
              {dips(ours, "stroke_dips")} %; at natural tempo {dips(rows.get(NATURAL, {}))} %.
            - {percent(ours["deep"])} of the default's transitions lead a hand more than 5 mm into the body; {deep} % of
              the classical ones without collision avoidance (`hold` apart, which does not move).
            - Seams in which a face jumps or blinks by half, with random faces: {faces(ours)} % by default,
              {faces(rows.get(NATURAL, {}))} % at natural tempo, {faces(rows.get(STITCHER, {}))} % by the stitcher; with
              other rests up to {worst_faces(found, DEFAULT)} and {worst_faces(found, NATURAL)} % by default and at
              natural tempo.
        """),
        "",
        *markdown(
            (
                *("method", "seconds", "velocity jump, m/s", "jerk ratio", "arms down, frames", "strokes whole"),
                *("deep", "dips, %"),
            ),
            [
                (
                    *(name, f"{r['seconds']:.2f}", f"{r['velocity_jump']:.2f}", f"{r['jerk_ratio']:.2f}"),
                    *(
                        f"{r['arms_down']:.1f}",
                        percent(r["whole"], 0),
                        "-" if r["deep"] is None else percent(r["deep"]),
                        dips(r),
                    ),
                )
                for name, r in rows.items()
            ],
        ),
        "",
        *prose("""
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
        *prose("""
            The same words, whose signer rests with one hand on the other before the belly (folded), with forearms
            before the waist (bent) or with hands that meet low. Back at rest: kept frames between the strokes with
            neither hand raised.
        """),
        "",
        *markdown(
            ("rest", "method", "back at rest, frames", "strokes whole", "velocity jump, m/s", "jerk ratio", "dips"),
            [
                (
                    *(rest, method, f"{r['arms_down']:.1f}", percent(r["whole"], 0)),
                    *(f"{r['velocity_jump']:.2f}", f"{r['jerk_ratio']:.2f}", dips(r)),
                )
                for rest, name in RESTS.items()
                for method in ("pose-velocity + hermite", DEFAULT)
                for r in [of(found[name], "method")[method]]
            ],
        ),
    ]
    table = [(rest, *row.values()) for rest, name in RESTS.items() for row in found[name]["rows"]]
    return lines, [("rest", *found["joins"]["rows"][0]), *table]


def hidden_frames(found: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """The learned transition over Hermite's, by clip and rate, and every method's error on the take."""
    ratios = {}
    for name, figures in found.items():
        rows = {(r["transition"], r["n_frames"]): r for r in figures["rows"]}
        lengths = sorted({n for _, n in rows})
        ratios[name] = [rows["learned", n]["position_error"] / rows["hermite", n]["position_error"] for n in lengths]
    take = {(r["transition"], r["n_frames"]): r for r in found["hidden-long-take-metres-30"]["rows"]}
    motion = [span([r["motion_ratio"] for (t, _), r in take.items() if t == name]) for name in ("learned", "hermite")]
    fps = {name: name.rpartition("-")[2] for name in found}
    long, keyed = ([name for name in found if take_name in name] for take_name in TAKES)

    def by_rate(names: Sequence[str]) -> str:
        return ", ".join(f"{span(ratios[name])} ({fps[name]} fps)" for name in names)

    lines = [
        *prose(f"""
            - On a captured take the learned transition has {by_rate(long)} of Hermite's error; on a clip that a program
              interpolated between keys {by_rate(keyed)}.
            - Its fingertips make {motion[0]} of the true motion at 30 fps; Hermite's {motion[1]}.
        """),
        "",
        "Learned over Hermite, error by number of hidden frames:",
        "",
        *markdown(
            ("clip, fps", *lengths),
            [
                (f"{TAKES[name.removeprefix('hidden-').rpartition('-')[0]]}, {fps[name]}", *(f"{x:.2f}" for x in row))
                for name, row in ratios.items()
            ],
        ),
        "",
        "Error of every method on the take at 30 fps, thousandths of the arm's length:",
        "",
        *markdown(
            ("transition", *lengths),
            [
                (name, *(f"{take[name, n]['position_error']:.1f}" for n in lengths))
                for name in dict.fromkeys(t for t, _ in take)
            ],
        ),
        "",
        *prose("""
            Frames are hidden from a clip; every transition fills them and sees 8 frames on either side. The error is
            the mean distance of elbows, wrists and fingers from the truth, relative to the root. Random gaps hide
            strokes as well as transitions, so they are harder than the gaps between signs: read the order of the
            methods. Fingers, trunk and head of `learned` are those of `hermite`; `learned` runs with collision
            avoidance, the others without. The clips, of upf-gti/SignON-editor (Apache-2.0), are not part of this
            project; the keyed one is no measure of real motion. Errors of hands, fingers and trunk, motion ratio,
            velocity jump and depth are in the CSV file.
        """),
    ]
    table = [(fps[name], name.removeprefix("hidden-"), *row.values()) for name in found for row in found[name]["rows"]]
    return lines, [("fps", "clip", *next(iter(found.values()))["rows"][0]), *table]


def collisions(found: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Every transition over a corpus of pairs."""
    rows = found["pairs"]["rows"]
    without = {r["transition"]: r for r in rows if not r["body_sense"]}
    moving = [100 * r["deep_gaps"] for name, r in without.items() if name not in ("hold", "learned")]
    avoiding = max(r["deep_gaps"] for r in rows if r["body_sense"])
    lines = [
        *prose(f"""
            - Without collision avoidance, {span(moving, ".1f")} % of the classical transitions lead a hand more than 5
              mm into head, trunk or the other hand, {percent(without["learned"]["deep_gaps"])} of the learned ones.
            - With collision avoidance, {percent(avoiding) if avoiding else "none"} of them does, by the same capsule
              body that it works on.
        """),
        "",
        *markdown(
            ("transition", "collision avoidance", "transitions deep", "frames deep", "deepest, mm"),
            [
                (
                    *(r["transition"], "yes" if r["body_sense"] else "no", percent(r["deep_gaps"])),
                    *(percent(r["deep_frames"]), f"{1e3 * r['deepest']:.1f}"),
                )
                for r in rows
            ],
        ),
        "",
        *prose(f"""
            Each row: {rows[0]["n_gaps"]} transitions of {rows[0]["n_frames"]} frames in all, every pair of the corpus
            ([corpus.md](../corpus.md)) at its true cut with its true number of frames. The first 3 mm, and the depth
            that the two ends of a transition already have, are not counted. `hold` does not move. The JSON file calls
            collision avoidance by its former name, `body_sense`.
        """),
    ]
    return lines, []


def bodies(found: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """What words keep on other bodies, rotations alone and fitted."""
    rows = {(r["body"], r["method"]): r for r in found["bodies-150"]["rows"]}
    names = list(dict.fromkeys(body for body, _ in rows))

    def kept(method: str, held_out: bool, key: str = "kept_frames") -> str:
        return span([100 * r[key] for (_, m), r in rows.items() if m == method and r["held_out"] == held_out], ".1f")

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
        *prose(f"""
            - Fitted, words keep {kept(FITTED, False)} % of the frames with a touch; with rotations copied
              {kept(ROTATIONS, False)} %.
            - On bodies and words on which no choice was made: {kept(FITTED, True)} % against {kept(ROTATIONS, True)} %.
            - Of touching pairs that do not lie deep at the source, {kept(FITTED, False, "kept_clear")} % are kept.
        """),
        "",
        *prose("""
            % of touching frames whose nearest pair keeps its distance within 5 mm; the same of pairs that lie less than
            2 mm deep at the source; the greatest depth of a hand beyond the source's, mm; processor time over that of
            rotations:
        """),
        "",
        *markdown(
            ("body", "rotations", "fitted", "clear pairs, fitted", "depth, rotations", "depth, fitted", "times"),
            [cells(body) for body in names],
        ),
        "",
        *prose(f"""
            {usual["n_words"]} words with {usual["n_touching"]} touching frames; kept aside {aside["n_words"]} words
            with {aside["n_touching"]}. The same of 40 words, and all other columns (places, directions, smoothness,
            time), are in the CSV file.
        """),
        "",
        "![Eight words at the frame in which most touches: the source, then on five bodies](../images/bodies.png)",
        "",
        *prose("""
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
        for name in found
        for row in found[name]["rows"]
    ]
    head = [key for key in found["bodies-150"]["rows"][0] if key != "worst"]
    return lines, [("figures", *head), *table]


def tempo(found: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Signs at running tempo beside the same as recorded."""
    rows = found["tempo"]["rows"]
    before, after = ([r for r in rows if r["tempo"] == tempo] for tempo in ("citation", "natural"))
    lost = [max(0.0, b["whole"] - a["whole"]) for b, a in zip(before, after, strict=True)]
    kept = min((r["contacts"] for r in after if r["contacts"] is not None), default=None)
    lines = [
        *prose(f"""
            - As recorded, a sign takes {span(r["ratio"] for r in before)} times the 0.70 s of running signing; with
              `--tempo natural` {span(r["ratio"] for r in after)} times.
            - {percent(max(lost), 0) if max(lost) else "None"} of the strokes that `citation` keeps is lost;
              {"no word has a contact" if kept is None else f"{percent(1 - kept, 0)} of the contacts at most"}.
        """),
        "",
        *markdown(
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
                    percent(r["whole"], 0),
                )
                for r in rows
            ],
        ),
        "",
        *prose(f"""
            {rows[0]["n_signs"]} words that ship and as many others by each of three other signers, and those that
            ship again, slowed and held longer or with noise; in sentences of seven, first and last left out. Jerk is
            over the recorded sign's, both scaled to one duration. What follows from this is in
            [evaluation.md](../evaluation.md).
        """),
    ]
    return lines, []


def bench(found: Mapping[str, Figures]) -> tuple[list[str], list[Sequence[object]]]:
    """Speed of every part."""
    parts = {name: part for name, part in found["bench"].items() if isinstance(part, dict) and name != "made_with"}
    learned, stream = parts["learned"], parts["stream"]
    lines = [
        *prose(f"""
            - A seam takes {learned["seam, p50, ms"]:.1f} ms by the default (99 %: {learned["seam, p99, ms"]:.1f} ms), a
              sentence of ten words {learned["sentence of 10 words, ms"]:.0f} ms.
            - The first piece of a stream is there after {stream["first piece, ms"]:.1f} ms.
        """),
        "",
        *markdown(
            ("part", "what", "figure"),
            [(name, what, f"{value:.4g}") for name, part in parts.items() for what, value in part.items()],
        ),
        "",
        *prose(f"""
            Medians of {found["bench"]["repeats"]} runs on one thread, clips of {found["bench"]["joints"]} joints. How
            each is taken, and the aims, are in [speed.md](../../../docs/speed.md).
        """),
    ]
    return lines, []


TITLES = {
    "seams": "Seams of words recorded apart",
    "hidden-frames": "Hidden frames",
    "collisions": "Hands in the body",
    "bodies": "Words on other bodies",
    "tempo": "Running tempo",
    "bench": "Speed",
}
PAGES = {
    "seams": Page(
        {name: f"evaluate seams 500 --rest {rest} --json" for rest, name in RESTS.items()},
        {name: f"evaluate seams 3 --rest {rest} --json" for rest, name in RESTS.items()},
        seams,
    ),
    "hidden-frames": Page(
        figures := {
            f"hidden-{name}-{fps}": f"evaluate clips {{real}}/{file}{rate} --json"
            for name, file in TAKES.items()
            for fps, rate in ((30, ""), (24, " --fps 24"))
        },
        figures,
        hidden_frames,
        tuple(TAKES.values()),
    ),
    "collisions": Page(
        {"pairs": "evaluate pairs {pairs} --json"}, {"pairs": "evaluate pairs {pairs} --limit 20 --json"}, collisions
    ),
    "bodies": Page(
        {name: f"evaluate bodies {n} --json" for name, n in (("bodies-150", 150), ("bodies", 40))},
        dict.fromkeys(("bodies-150", "bodies"), "evaluate bodies 6 --json"),
        bodies,
    ),
    "tempo": Page({"tempo": "evaluate tempo 40 --json"}, {"tempo": "evaluate tempo 7 --json"}, tempo),
    "bench": Page({"bench": "bench --repeats 15 --json"}, {"bench": "bench --repeats 3 --json"}, bench),
}


def page_text(name: str, folder: Path = DOCS) -> tuple[str, str]:
    """A page and its CSV file, empty where it has none, of the figures in a folder."""
    page = PAGES[name]
    found = {one: json.loads((folder / f"{one}.json").read_text(encoding="utf-8")) for one in page.figures}
    lines, table = page.write(found)
    files = [f"[{one}.json]({one}.json)" for one in found] + ([f"[{name}.csv]({name}.csv)"] if table else [])
    tail = ["", *made_with(found.values()), "Figures, with their signatures:", ",\n".join(files) + ". Made by", ""]
    tail += [f"    signsplice {words.format(real='DIR', pairs='out/pairs')}" for words in page.figures.values()]
    tail += ["", f"all together by `make measured-{name}`."]
    return "\n".join([f"# {TITLES[name]}", "", *lines, *tail]) + "\n", csv_text(*_rounded(table)) if table else ""


def _rounded(table: Sequence[Sequence[object]]) -> tuple[Sequence[object], list[list[object]]]:
    """The head and the rows of a table, with numbers of five digits."""
    rows = [[f"{cell:.5g}" if isinstance(cell, float) else cell for cell in row] for row in table[1:]]
    return table[0], rows


def run(words: Sequence[str], **more: Any) -> subprocess.CompletedProcess[str]:
    """A run of the command line on one thread."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    call = [sys.executable, "-m", "signsplice", *words]
    return subprocess.run(call, check=True, text=True, env=environment, cwd=ROOT, **more)


def git(*words: str) -> str:
    """What git prints."""
    return subprocess.run(["git", *words], check=True, capture_output=True, text=True, cwd=ROOT).stdout.strip()


def stamp() -> dict[str, object]:
    """What makes the figures: commit, version, words and networks."""
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
    """The figures of one command, stamped; those of an earlier call with the same sources, where there are some."""
    kept = work / f"{name}.json"
    if not kept.exists():
        pairs = corpus(work) if "{pairs}" in words else None
        print(f"measuring {name}", file=sys.stderr, flush=True)
        stamped = {"made_with": stamp()}
        call = [word.format(real=real, pairs=pairs) for word in words.split()]
        figures = json.loads(run(call, stdout=subprocess.PIPE).stdout)
        kept.with_suffix(".part").write_text(json.dumps({**stamped, **figures}, indent=2) + "\n", encoding="utf-8")
        kept.with_suffix(".part").replace(kept)
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def corpus(work: Path) -> Path:
    """The corpus of pairs of these sources."""
    small = ("--words", "4", "--other-signer", "4") if work.name.endswith("small") else ()
    if not (work / "pairs" / "corpus.json").exists():
        run(["synth", "pairs", "-o", str(work / "pairs"), *small], stdout=subprocess.DEVNULL)
    return work / "pairs"


def write_corpus_page(work: Path, real: Path, docs: Path) -> None:
    """The page of the corpus: `evaluate corpus`, with the captured take alone, and a line that says what made it."""
    page, images = docs / "corpus.md", docs.parent / "images"
    if docs != DOCS:
        shutil.copy(DOCS / page.name, page)
        images.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        take = TAKES["long-take-metres"]
        (Path(folder) / take).symlink_to((real / take).resolve())
        call = ["evaluate", "corpus", str(corpus(work)), "--page", str(page), "--images", str(images)]
        run([*call, "--real", folder, "--real-frames", LEARNED_FRAMES], stdout=subprocess.DEVNULL)
    lines = made_with([{"made_with": stamp()}])
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("\nCorpus `", "\n".join(["", *lines, "Corpus `"]), 1), encoding="utf-8")


def write_bulk_page(work: Path, docs: Path) -> None:
    """The page of sentences in bulk."""
    from signsplice.bench import bulk

    figures = measure("scale", "bench bulk --json", work, None)
    (docs / "scale.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    (docs / "scale.md").write_text(bulk.page(figures), encoding="utf-8")


def write_page(name: str, work: Path, real: Path | None, docs: Path, small: bool) -> None:
    """One page, its JSON files and its CSV file."""
    page = PAGES[name]
    for one, words in (page.small if small else page.figures).items():
        figures = measure(one, words, work, real)
        (docs / f"{one}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    if name == "bodies" and not small:
        picture = docs.parent / "images" / "bodies.png"
        run(["evaluate", "bodies", "3", "--picture", str(picture)], stdout=subprocess.DEVNULL)
    text, table = page_text(name, docs)
    (docs / f"{name}.md").write_text(text, encoding="utf-8")
    if table:
        (docs / f"{name}.csv").write_text(table, encoding="utf-8")


def main() -> None:
    """Make the pages that are named; by default all but `scale`."""
    names = [*PAGES, "corpus", "scale"]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"{', '.join(names)}; default: all but scale")
    parser.add_argument("--real", type=Path, metavar="DIR", help="folder of the clips of real signing")
    parser.add_argument("--small", type=Path, metavar="DIR", help="try the commands on a few words, into this folder")
    parser.add_argument("--from-json", action="store_true", help="write the pages from the figures that are there")
    given = parser.parse_args()
    if unknown := [name for name in given.pages if name not in names]:
        parser.error(f"no page {unknown[0]!r}, expected one of {', '.join(names)}")
    pages = given.pages or names[:-1]
    if given.from_json:
        for name in (name for name in pages if name in PAGES):
            text, table = page_text(name)
            (DOCS / f"{name}.md").write_text(text, encoding="utf-8")
            if table:
                (DOCS / f"{name}.csv").write_text(table, encoding="utf-8")
        return
    if given.small is None and git("status", "--porcelain", "src", "workshop/src"):
        sys.exit("the sources have changes that are not committed, and a page names its commit: commit them first")
    trees = "-".join(git("rev-parse", f"HEAD:{folder}")[:8] for folder in ("src/signsplice", "workshop/src"))
    key = f"{trees}{'-small' if given.small else ''}"
    work, docs = (given.small or ROOT / "out") / "measured" / key, given.small or DOCS
    work.mkdir(parents=True, exist_ok=True)
    for name in pages:
        needed = PAGES[name].real if name in PAGES else (TAKES["long-take-metres"],) if name == "corpus" else ()
        missing = [file for file in needed if given.real is None or not (given.real / file).is_file()]
        if missing:
            print(f"{name}: skipped, needs {' and '.join(missing)}: REAL=DIR names their folder", file=sys.stderr)
        elif name == "corpus":
            write_corpus_page(work, given.real, docs)
        elif name == "scale":
            write_bulk_page(work, docs)
        else:
            write_page(name, work, given.real, docs, given.small is not None)


if __name__ == "__main__":
    main()
