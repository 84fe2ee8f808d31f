"""Contact sheets (``.png``) and films (``.gif``, ``.mp4``), written atomically."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError, MissingExtraError, SignspliceError
from signsplice.formats.atomic import replacing
from signsplice.motion import Clip
from signsplice.progress import Progress, track_progress
from signsplice.render import PICTURE_SUFFIXES
from signsplice.render.picture import Scene, detail_colours, draw, make_scene
from signsplice.render.sheet import INK, PAPER, SIGN, TRANSITION, Mark, caption, write_line, write_sheet
from signsplice.render.skin import pillow

__all__ = ["Mark", "Progress", "find_ffmpeg", "gif_timing", "write_pictures"]

GIF_FPS = 25.0
"""Highest frame rate that viewers play reliably in a GIF; faster clips lose frames."""

GIF_SIZE = (480, 480)
"""Default width and height of a GIF, pixels."""
_N_PICTURE_COLOURS = 200
"""Number of GIF colours chosen from the first picture; the rest are reserved for marks, hands and mouth."""

MP4_SIZE = (1080, 1080)
"""Default width and height of an .mp4, pixels."""
CRF = 20
"""x264's constant rate factor: 0 is lossless, 51 the lowest quality."""


def write_pictures(
    clip: Clip,
    path: str | Path,
    marks: Sequence[Mark] = (),
    view: str = "front",
    progress: Progress | None = None,
    size: tuple[int, int] | None = None,
    crf: int = CRF,
) -> None:
    """Draw a clip from one of ``picture.VIEWS``: a contact sheet (.png) or a film (.gif, .mp4), by suffix.

    marks: spans shown in the picture. size: width and height of a film in pixels, both even, from 64, such as
    (1920, 1080). crf: quality of .mp4, see ``CRF``. Raises ``MissingExtraError`` if Pillow or ffmpeg is missing,
    ``InputError`` for arguments outside these.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in PICTURE_SUFFIXES:
        raise InputError(f"{path}: pictures end in {', '.join(PICTURE_SUFFIXES)}, not {suffix or '(nothing)'}")
    if size is not None and (suffix == ".png" or min(size) < 64 or any(side % 2 for side in size)):
        raise InputError(f"size {size} for {suffix}: expected even width and height from 64, for .gif and .mp4 only")
    if not 0 <= crf <= 51:
        raise InputError(f"crf {crf}, expected 0 (loses nothing) to 51")
    scene, is_gif = make_scene(clip, view), suffix == ".gif"
    with replacing(path) as temporary:
        if suffix == ".png":
            write_sheet(clip, scene, temporary, marks, progress)
            return
        frames, delays = gif_timing(len(clip), clip.fps) if is_gif else ([*range(len(clip))], [])
        size = size or (GIF_SIZE if is_gif else MP4_SIZE)
        pages = _pictures(clip, scene, size, track_progress(frames, progress), marks)
        if is_gif:
            _write_gif(pages, delays, temporary)
        else:
            _write_mp4(pages, size, clip.fps, crf, temporary)


def _pictures(
    clip: Clip, scene: Scene, size: tuple[int, int], frames: Iterable[int], marks: Sequence[Mark]
) -> Iterator[Any]:
    """Yields Pillow images of ``frames``: the signer, with a bar below for the caption, the spans and the playhead."""
    pillow_image, pillow_draw = pillow("Image"), pillow("ImageDraw")
    width, height = size
    bar = max(36, height // 14) // 2 * 2
    for frame in frames:
        page = pillow_image.new("RGB", size, PAPER)
        page.paste(pillow_image.fromarray(draw(scene, frame, width, height - bar)), (0, 0))
        pen = pillow_draw.Draw(page)
        text, ink = caption(marks, frame)
        if ink == TRANSITION:  # around the picture only: the timeline below stays visible
            pen.rectangle((0, 0, width - 1, height - bar - 1), outline=TRANSITION, width=max(2, width // 160))
        write_line(pen, text, 0.5 * width, height - bar + 2, width - 16, ink, bar // 2)
        timeline_px = max(8, height // 90)
        for mark in marks:
            x0, x1 = (round(width * edge / len(clip)) for edge in (mark.start, mark.stop))
            pen.rectangle((x0, height - timeline_px, max(x1 - 1, x0), height - 1), fill=mark.colour)
        playhead_x = round(width * (frame + 0.5) / len(clip))
        pen.rectangle(
            (playhead_x - timeline_px // 4, height - timeline_px * 3 // 2, playhead_x + timeline_px // 4, height - 1),
            fill=INK,
        )
        yield page


def _write_gif(pages: Iterator[Any], delays: Sequence[int], path: Path) -> None:
    """Write pictures as a GIF; ``delays``: duration of each, hundredths of a second."""
    pillow_image, palette = pillow("Image"), None
    drawn: list[Any] = []
    for page in pages:
        palette = palette or _with_reserved_colours(
            page.quantize(colors=_N_PICTURE_COLOURS, method=pillow_image.Quantize.MEDIANCUT)
        )
        drawn.append(page.quantize(palette=palette, dither=pillow_image.Dither.NONE))
    milliseconds = [10 * delay for delay in delays]
    options = {"append_images": drawn[1:], "duration": milliseconds, "loop": 0, "optimize": False}
    drawn[0].save(path, format="GIF", save_all=True, **options)


def _with_reserved_colours(palette: Any) -> Any:
    """Adds the colours of marks, hands and mouth to a palette; the first picture may show few of them."""
    colours = palette.getpalette()[: _N_PICTURE_COLOURS * 3]
    colours += [PAPER[0]] * (_N_PICTURE_COLOURS * 3 - len(colours))
    colours += [channel for colour in detail_colours() for channel in colour]
    for colour in (TRANSITION, SIGN, INK):
        for alpha in (1.0, 0.75, 0.5, 0.25):
            colours += [round(alpha * c + (1.0 - alpha) * p) for c, p in zip(colour, PAPER, strict=True)]
    palette.putpalette([*colours, *PAPER])
    return palette


def gif_timing(n_frames: int, fps: float) -> tuple[list[int], list[int]]:
    """Returns the frames of a clip for a GIF, and the duration of each in hundredths of a second.

    Each frame ends at the hundredth nearest to its time in the clip, so that rounding errors do not accumulate.
    """
    n_shown = max(1, int(np.ceil(n_frames * min(1.0, GIF_FPS / fps))))
    starts = np.floor(np.arange(n_shown) * n_frames / n_shown + 1e-9).astype(int)
    ends = np.append(starts[1:], n_frames)
    hundredths = np.round(np.append(0, ends) * 100.0 / fps).astype(int)
    return starts.tolist(), np.maximum(np.diff(hundredths), 1).tolist()


def _write_mp4(pages: Iterator[Any], size: tuple[int, int], fps: float, crf: int, path: Path) -> None:
    """Write pictures as a film with ffmpeg."""
    command = [
        *(find_ffmpeg(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
        *("-s", f"{size[0]}x{size[1]}", "-r", f"{fps:.6f}", "-i", "-", "-an"),
        *("-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", str(crf)),
        *("-movflags", "+faststart", "-f", "mp4", str(path)),
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin is not None
    try:
        for page in pages:
            process.stdin.write(page.tobytes())
        _, errors = process.communicate()
    except BrokenPipeError:
        _, errors = process.communicate()
    except BaseException:
        process.kill()
        process.communicate()  # closes both pipes and waits
        raise
    if process.returncode != 0:
        reason = errors.decode(errors="replace").strip().splitlines()
        raise SignspliceError(f"ffmpeg failed: {reason[-1] if reason else process.returncode}")


def find_ffmpeg() -> str:
    """Returns the path of ffmpeg, from PATH or else imageio-ffmpeg. Raises ``MissingExtraError`` if both lack it."""
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        try:
            ffmpeg = import_module("imageio_ffmpeg").get_ffmpeg_exe()
        except (ImportError, RuntimeError) as error:
            raise MissingExtraError(
                "films in .mp4 need an ffmpeg: install one, or pip install imageio-ffmpeg; .gif works without"
            ) from error
    return str(ffmpeg)
