"""The pictures of docs/face.md and docs/formats.md, and the film of the README, drawn by the package itself.

    python workshop/runs/face_sheets.py docs/images

Call it again when ``figure.py`` beside it has changed the head. It needs Pillow, and for faces in other programs what
``npm ci`` installs in viewer/, and ``CHROMIUM=FILE`` in the environment.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image, ImageSequence

from signsplice import read_avatar, retarget, save
from signsplice.lexicon import open_shipped_lexicon
from signsplice.lexicon.sentence import brows, parse, pauses, starts
from signsplice.motion import Clip, copy_unchecked, resample
from signsplice.motion.face import ARKIT_CHANNELS, VISEMES, Face
from signsplice.render import film
from signsplice.render.picture import Image as Pixels
from signsplice.render.picture import Scene, draw, make_scene
from signsplice.render.sheet import PAPER, write_cells
from signsplice.rig.info import rig_info
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.faces import LIDS, RULES
from signsplice.splicing.result import SpliceResult

ROOT = Path(__file__).resolve().parents[2]
SIZE, COLUMNS, COLOURS = 120, 9, 128
REACH, ABOVE = 0.072, 0.044
"""Half of what is shown of a head, and its middle above the head's joint, statures."""
_BOTH = ("Left", "Right")
FACES: Mapping[str, Mapping[str, float]] = {
    "at rest": {},
    "closed eyes": {f"eyeBlink{side}": 1.0 for side in _BOTH},
    "brows up": {"browInnerUp": 0.7, "browOuterUpLeft": 0.8, "browOuterUpRight": 0.8},
    "brows down": {f"browDown{side}": 0.8 for side in _BOTH},
    "open mouth": {"jawOpen": 0.6},
    "smile": {f"mouthSmile{side}": 0.8 for side in _BOTH},
    "pucker": {"mouthPucker": 0.9},
    "look aside": {"eyeLookOutLeft": 0.8, "eyeLookInRight": 0.8},
}


def heads(clip: Clip, view: str = "front", reach: float = REACH) -> Scene:
    """A clip's head, where it is in the first frame."""
    scene = make_scene(clip, view)
    at = scene.positions[0, rig_info(clip.skeleton).roles.joints["head"]] - scene.origin
    x, y, _ = (at @ scene.axes.T / scene.height).tolist()
    return replace(scene, window=(x - reach, x + reach, y + ABOVE - reach, y + ABOVE + reach))


def with_shapes(shapes: Sequence[Mapping[str, float]]) -> Clip:
    """A still signer with a face in each frame."""
    clip = _held(open_shipped_lexicon().clip("NAME"), len(shapes))
    weights = np.array([[shape.get(name, 0.0) for name in ARKIT_CHANNELS] for shape in shapes])
    return copy_unchecked(clip, face=Face(ARKIT_CHANNELS, weights))


def _held(clip: Clip, n_frames: int) -> Clip:
    first = clip[:1]
    return replace(
        first,
        local_rotations=first.local_rotations.repeat(n_frames, axis=0),
        root_positions=first.root_positions.repeat(n_frames, axis=0),
    )


def write_shapes(
    shapes: Mapping[str, Mapping[str, float]], path: Path, columns: int = COLUMNS, size: int = SIZE
) -> None:
    """A page of faces, each with its name."""
    scene = heads(with_shapes(list(shapes.values())))
    cells = [(draw(scene, frame, size, size), name) for frame, name in enumerate(shapes)]
    write_cells(cells, path, columns, COLOURS)


def spliced(line: str) -> SpliceResult:
    """A sentence with its face by rule."""
    with open_shipped_lexicon() as words:
        units = parse(line, words)
        clips = [words.clip(gloss) for unit in units for gloss in unit.glosses]
    return splice(clips, SpliceOptions(face_rules=RULES), starts(units), pauses(units), brows(units))


def sentence(line: str) -> tuple[Clip, Sequence[tuple[int, str]]]:
    """A sentence, and frames to show of it: each sign, each transition and every blink."""
    result = spliced(line)
    lids = result.clip.face.of(LIDS)[:, 0] if result.clip.face is not None else np.zeros(len(result.clip))
    shown = {sum(span.output) // 2: span.name or "transition" for span in result.spans}
    shown |= {k: "blink" for k in range(1, len(lids) - 1) if lids[k] == 1.0 > lids[k - 1]}
    return result.clip, sorted(shown.items())


def write_sentences(lines: Sequence[str], path: Path, columns: int = 8, size: int = 170) -> None:
    """A row of frames for each sentence, its signer from the front, and the face below."""
    cells: list[tuple[Pixels, str]] = []
    for line in lines:
        clip, shown = sentence(line)
        whole = make_scene(clip)
        for frame, name in shown[:columns]:
            head = heads(clip[frame : frame + 1])
            picture = np.concatenate([draw(whole, frame, size, size), draw(head, 0, size, size)])
            cells.append((picture, f"{name}, {frame / clip.fps:.1f} s"))
        cells += [(np.full_like(cells[0][0], PAPER), "")] * (columns - len(shown))
    write_cells(cells, path, columns, COLOURS)


def write_film(line: str, path: Path, fps: float = 10.0, n_colours: int = 32) -> None:
    """A small film of a sentence for the README."""
    result = spliced(line)
    rate = fps / result.clip.fps
    marks = [film.Mark(s.kind, s.name or "", *(round(at * rate) for at in s.output)) for s in result.spans]
    film.write_pictures(resample(result.clip, fps), path, marks, size=(240, 320))
    pages = Image.open(path)
    frames = [page.convert("RGB") for page in ImageSequence.Iterator(pages)]
    palette = frames[len(frames) // 3].quantize(n_colours, Image.Quantize.MEDIANCUT)
    small = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in frames]
    small[0].save(path, save_all=True, append_images=small[1:], duration=round(1000 / fps), loop=0, optimize=True)


PLAYED: Sequence[Mapping[str, float]] = (
    FACES["brows up"] | FACES["open mouth"],
    FACES["brows down"] | FACES["pucker"],
    FACES["smile"] | {"eyeBlinkLeft": 1.0},
    FACES["look aside"] | {"eyeBlinkRight": 0.3, "jawOpen": 0.35, "tongueOut": 0.9},
)


def write_players(path: Path) -> None:
    """The same faces on the figure and on avatars, as three.js and three-vrm play them; needs node and Chromium."""
    sys.path.insert(0, str(ROOT / "tests"))
    import face_avatars

    clip = with_shapes(PLAYED)
    with TemporaryDirectory() as name:
        folder = Path(name)
        save(clip, folder / "figure.glb")
        pairs = {"figure, .glb": (folder / "figure.glb", "-")}
        for kind in face_avatars.KINDS:
            avatar = face_avatars.write(folder, kind)
            out = folder / f"{avatar.stem}-out{'.glb' if kind == 'arkit.glb' else '.vrma'}"
            save(retarget(clip, read_avatar(avatar)).clip, out)
            pairs[f"{kind}, {out.suffix}"] = (out, "-") if kind == "arkit.glb" else (avatar, out)
        files = [str(file) for pair in pairs.values() for file in pair]
        command = ["node", str(ROOT / "viewer/checks/faces.mjs"), name, "30", str(len(PLAYED)), *files]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        rows = range(len(pairs))
        cells = [
            (np.asarray(Image.open(folder / f"{row}-{frame}.png").convert("RGB")), list(pairs)[row])
            for frame in range(len(PLAYED))
            for row in rows
        ]
        write_cells(cells, path, len(pairs), COLOURS)


def main(folder: Path) -> None:
    """Write every page."""
    together = {"mouthClose": {"mouthClose": 0.6, "jawOpen": 0.6}}  # it closes the lips of an open jaw
    write_shapes({name: {name: 1.0} for name in ARKIT_CHANNELS} | together, folder / "face-shapes.png")
    write_shapes(VISEMES, folder / "face-visemes.png", 8)
    write_shapes(FACES, folder / "figure-face.png", 4, 180)
    write_sentences(("YOU LIKE COFFEE?", "YOU WHERE LIVE?"), folder / "face-questions.png")
    write_film("HELLO I DEAF I SIGN THANK-YOU", folder / "sentence.gif")
    write_players(folder / "face-players.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
