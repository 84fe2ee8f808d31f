"""Contact sheets and films: .png, .gif, .mp4, written whole or not at all."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from signsplice.errors import InputError, MissingExtraError, SignspliceError
from signsplice.formats.atomic import replacing
from signsplice.motion.clip import Clip
from signsplice.render.picture import Scene, draw, draw_hand, has_hands, scene

Progress = Callable[[int, int], None]

GIF_FPS = 25.0
"""The most frames a second that viewers play a GIF at faithfully; faster clips are thinned."""

GIF_SIZE = (480, 480)
MP4_SIZE = (1080, 1040)
_CELL = (224, 224)
_STRIP = 76
_COLUMNS = 8
_N_CELLS = 32

_INK, _PAPER = (45, 45, 50), (244, 241, 236)
_SIGN, _TRANSITION = (108, 128, 160), (222, 142, 32)


@dataclass(frozen=True)
class Mark:
    """A stretch of frames [start, stop) to be marked: kind "sign" or "transition", and the word's name."""

    kind: str
    name: str
    start: int
    stop: int


def write(
    clip: Clip,
    path: str | Path,
    marks: Sequence[Mark] = (),
    view: str = "front",
    progress: Progress | None = None,
) -> None:
    """Draw a clip from one of ``picture.VIEWS``: a contact sheet (.png) or a film (.gif, .mp4), by suffix.

    Raises ``MissingExtraError`` where Pillow or an ffmpeg is missing, ``InputError`` for another suffix.
    """
    suffix = Path(path).suffix.lower()
    writers = {".png": _write_sheet, ".gif": _write_gif, ".mp4": _write_mp4}
    if suffix not in writers:
        raise InputError(f"{path}: pictures end in {', '.join(writers)}, not {suffix or '(nothing)'}")
    ready = scene(clip, view)
    with replacing(path) as temporary:
        writers[suffix](clip, ready, temporary, marks, progress)


def _pillow(module: str) -> ModuleType:
    try:
        return import_module(f"PIL.{module}")
    except ImportError as error:
        raise MissingExtraError("pictures need Pillow: pip install 'signsplice[video]'") from error


def _mark_at(marks: Sequence[Mark], frame: int) -> Mark | None:
    return next((mark for mark in marks if mark.start <= frame < mark.stop), None)


def _write_sheet(clip: Clip, ready: Scene, path: Path, marks: Sequence[Mark], progress: Progress | None) -> None:
    frames = sheet_frames(len(clip), marks)
    image_, draw_, font_ = _pillow("Image"), _pillow("ImageDraw"), _pillow("ImageFont")
    columns = min(_COLUMNS, len(frames))
    rows = -(-len(frames) // columns)
    w, h = _CELL[0] + 8, _CELL[1] + _STRIP + 8
    sheet = image_.new("RGB", (columns * w, rows * h), _PAPER)
    pen, font = draw_.Draw(sheet), font_.load_default(15)
    hands = has_hands(clip)
    for n, frame in enumerate(frames):
        x, y = n % columns * w + 4, n // columns * h + 4
        sheet.paste(image_.fromarray(draw(ready, frame, *_CELL)), (x, y))
        if hands:  # the signer's right hand on the left, as the viewer sees it
            for side, left in (("right", x), ("left", x + _CELL[0] - _STRIP)):
                sheet.paste(image_.fromarray(draw_hand(ready, frame, side, _STRIP)), (left, y + _CELL[1]))
        mark = _mark_at(marks, frame)
        moving = mark is not None and mark.kind == "transition"
        if moving:
            pen.rectangle((x - 2, y - 2, x + _CELL[0] + 1, y + _CELL[1] + _STRIP + 1), outline=_TRANSITION, width=3)
        name = "transition" if moving else mark.name if mark is not None else ""
        for line, text in enumerate((name, f"frame {frame}", f"{frame / clip.fps:.2f} s")):
            left = x + 0.5 * (_CELL[0] - pen.textlength(text, font=font))
            ink = _TRANSITION if moving and line == 0 else _INK
            pen.text((left, y + _CELL[1] + 8 + 20 * line), text, fill=ink, font=font)
        if progress is not None:
            progress(n + 1, len(frames))
    sheet.save(path, format="PNG")


def sheet_frames(n_frames: int, marks: Sequence[Mark], n_cells: int = _N_CELLS) -> list[int]:
    """Which frames a contact sheet shows: the last and first kept frames at every seam, the ends and the middle of
    every transition, and others spread evenly where room is left.
    """
    chosen: set[int] = set()
    for mark in marks:
        if mark.kind == "transition":
            chosen |= {mark.start - 1, mark.start, (mark.start + mark.stop - 1) // 2, mark.stop - 1, mark.stop}
    chosen = {frame for frame in chosen if 0 <= frame < n_frames}
    for n_even in range(min(max(n_cells - len(chosen), _COLUMNS), n_frames), 0, -1):
        frames = chosen | set(np.linspace(0, n_frames - 1, n_even).round().astype(int).tolist())
        if len(frames) % _COLUMNS == 0 or len(frames) < _COLUMNS:  # whole rows
            break
    return sorted(frames)


def _pictures(
    clip: Clip, ready: Scene, size: tuple[int, int], frames: Sequence[int], marks: Sequence[Mark]
) -> Iterator[Any]:
    """Pillow images of ``frames``: the signer over a bar that shows the spans, where playing is, and the word."""
    image_, draw_, font_ = _pillow("Image"), _pillow("ImageDraw"), _pillow("ImageFont")
    width, height = size
    bar = max(36, height // 14) // 2 * 2
    font = font_.load_default(bar // 2)
    for frame in frames:
        page = image_.new("RGB", size, _PAPER)
        page.paste(image_.fromarray(draw(ready, frame, width, height - bar)), (0, 0))
        pen = draw_.Draw(page)
        for mark in marks:
            x0, x1 = (round(width * at / len(clip)) for at in (mark.start, mark.stop))
            pen.rectangle(
                (x0, height - 8, x1 - 1, height - 1), fill=_TRANSITION if mark.kind == "transition" else _SIGN
            )
        now = round(width * (frame + 0.5) / len(clip))
        pen.rectangle((now - 2, height - 12, now + 1, height - 1), fill=_INK)
        current = _mark_at(marks, frame)
        if current is not None:
            moving = current.kind == "transition"
            label = "transition" if moving else current.name
            at = (0.5 * (width - pen.textlength(label, font=font)), height - bar + 2)
            pen.text(at, label, fill=_TRANSITION if moving else _INK, font=font)
            if moving:
                pen.rectangle((0, 0, width - 1, height - 1), outline=_TRANSITION, width=max(2, width // 160))
        yield page


def _write_gif(clip: Clip, ready: Scene, path: Path, marks: Sequence[Mark], progress: Progress | None) -> None:
    frames, delays = gif_timing(len(clip), clip.fps)
    pages: list[Any] = []
    image_ = _pillow("Image")
    palette: Any = None
    for page in _pictures(clip, ready, GIF_SIZE, frames, marks):
        if palette is None:
            palette = page.quantize(colors=240, method=image_.Quantize.MEDIANCUT)
            palette = _with_colours(page, palette)
        pages.append(page.quantize(palette=palette, dither=image_.Dither.NONE))
        if progress is not None:
            progress(len(pages), len(frames))
    pages[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=pages[1:],
        duration=[10 * d for d in delays],
        loop=0,
        optimize=False,
    )


def _with_colours(page: Any, palette: Any) -> Any:
    """The palette with the marks' colours added, since the first picture may show none of them."""
    colours = palette.getpalette()[: 240 * 3]
    for colour in (_TRANSITION, _SIGN, _INK, _PAPER):
        for share in (1.0, 0.75, 0.5, 0.25):
            colours += [round(share * c + (1.0 - share) * p) for c, p in zip(colour, _PAPER, strict=True)]
    palette.putpalette(colours[:768])
    return palette


def gif_timing(n_frames: int, fps: float) -> tuple[list[int], list[int]]:
    """Frames of a clip that a GIF shows, and how long each stays, in hundredths of a second.

    GIF counts in hundredths: each delay ends at the hundredth nearest to the clip's own time, so errors never add up.
    """
    shown = max(1, int(np.ceil(n_frames * min(1.0, GIF_FPS / fps))))
    starts = np.floor(np.arange(shown) * n_frames / shown + 1e-9).astype(int)
    ends = np.append(starts[1:], n_frames)
    hundredths = np.round(np.append(0, ends) * 100.0 / fps).astype(int)
    return starts.tolist(), np.maximum(np.diff(hundredths), 1).tolist()


def _write_mp4(clip: Clip, ready: Scene, path: Path, marks: Sequence[Mark], progress: Progress | None) -> None:
    width, height = MP4_SIZE
    command = [
        *(find_ffmpeg(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
        *("-s", f"{width}x{height}", "-r", f"{clip.fps:.6f}", "-i", "-", "-an"),
        *("-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-movflags", "+faststart", "-f", "mp4", str(path)),
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin is not None
    try:
        for n, page in enumerate(_pictures(clip, ready, MP4_SIZE, range(len(clip)), marks)):
            process.stdin.write(page.tobytes())
            if progress is not None:
                progress(n + 1, len(clip))
        _, said = process.communicate()
    except BrokenPipeError:
        _, said = process.communicate()
    except BaseException:
        process.kill()
        process.wait()
        raise
    if process.returncode != 0:
        reason = said.decode(errors="replace").strip().splitlines()
        raise SignspliceError(f"ffmpeg failed: {reason[-1] if reason else process.returncode}")


def find_ffmpeg() -> str:
    """Path of an ffmpeg: the one on PATH, else the one that imageio-ffmpeg brings. Raises ``MissingExtraError``."""
    found = shutil.which("ffmpeg")
    if found is None:
        try:
            found = import_module("imageio_ffmpeg").get_ffmpeg_exe()
        except (ImportError, RuntimeError) as error:
            raise MissingExtraError(
                "films in .mp4 need an ffmpeg: install one, or pip install imageio-ffmpeg; .gif works without"
            ) from error
    return str(found)
