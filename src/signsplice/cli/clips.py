"""Reads and writes clips for commands: reads with roles, writes by suffix, checks output names before any work."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from os.path import samestat
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice import formats
from signsplice.cli.options import combine_options, flag, option, preset, two_numbers
from signsplice.cli.terminal import note, progress, warn
from signsplice.errors import FormatError, InputError, LimitError
from signsplice.formats import ReadAs
from signsplice.formats.atomic import check_writable
from signsplice.formats.reading import DEFAULT_LIMITS, NO_LIMITS, ReadLimits
from signsplice.render import PICTURE_SUFFIXES

if TYPE_CHECKING:
    from signsplice.body.capsules import Avatar
    from signsplice.motion import Clip

OUTPUT_SUFFIXES = (*formats.WRITE_SUFFIXES, *PICTURE_SUFFIXES)
"""Suffixes that ``write`` writes, for help texts."""
SKIN = option(
    "--skin",
    "NAME",
    "Mesh, node or material of the avatar that is skin; others are cloth; may be repeated.",
    multiple=True,
)
"""Option of commands with ``--avatar``; may be repeated."""
PICTURES = combine_options(
    preset("--view", "front", "VIEW", "View of a picture: front, three-quarter or side."),
    option("--size", "WxH", "Of a film, pixels, e.g. 1920x1080.  [default: .mp4 1080x1080, .gif 480x480]"),
)
"""Options of commands that write pictures."""
Spans = Sequence[tuple[str, str, int, int]]
"""Kind, name, first frame and end (exclusive) of each span."""
Command = TypeVar("Command", bound=Callable[..., Any])


def _keep(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    """Store the value of an option for functions that read clips in the current command."""
    context.meta[f"{__name__}.{parameter.name}"] = value


def _option_value(name: str) -> Any:
    """Return the value of an option of the current command; None if it has no such option."""
    return click.get_current_context().meta.get(f"{__name__}.{name}")


def _lifts_limits(command: Command) -> Command:
    """Add ``--no-limits`` to a command."""

    @flag("--no-limits", "Read clips of any size: for files that you trust.", expose_value=False, callback=_keep)
    @wraps(command)
    def with_limits(*args: Any, **options: Any) -> Any:
        try:
            return command(*args, **options)
        except LimitError as error:
            raise InputError(f"{error}; --no-limits lifts the limits, for files that you trust") from error

    return with_limits  # type: ignore[return-value]


_ROLES = "JSON of role -> joint name, for rigs not known by name."
_REST_FRAME = "Frame with the rest pose, for rigs whose zero pose shows no person.  [default: the first that shows one]"
_TAKE = "Take of an .fbx file.  [default: the first that moves its joints]"
_INPUT_FPS = "Rate at which clips were recorded, if their files do not say, or say what is wrong."
_FACE_FPS = "Rate of a face in CSV.  [default: as its timecodes imply]"


def _kept(names: str, metavar: str, text: str, **kind: Any) -> Callable[[Command], Command]:
    """Return an option for functions that read clips; the command itself does not get it."""
    return option(names, metavar, text, expose_value=False, callback=_keep, **kind)


reads_words = combine_options(
    _lifts_limits,
    _kept("--roles", "FILE", _ROLES),
    _kept("--rest-frame", "N", _REST_FRAME, type=click.IntRange(0)),
)
"""Options of commands that use clips of a lexicon."""
reads_clips = combine_options(
    reads_words,
    _kept("--take", "NAME", _TAKE),
    _kept("--input-fps", "N", _INPUT_FPS, type=float),
    _kept("--face-fps", "N", _FACE_FPS, type=float),
)
"""Options of commands that read clips from files: how they are read, and ``--no-limits``."""


def read_as() -> ReadAs:
    """Return how the current command reads clips."""
    return ReadAs(
        fps=_option_value("input_fps"),
        face_fps=_option_value("face_fps"),
        take=_option_value("take") or "",
        rest_frame=_option_value("rest_frame"),
        roles=read_roles(_option_value("roles")),
    )


def limits() -> ReadLimits:
    """Return the limits on the clips that the current command reads."""
    return NO_LIMITS if _option_value("no_limits") else DEFAULT_LIMITS


def load_body(path: str) -> Clip:
    """Read a clip whose motion does not count."""
    return load(path, read=ReadAs(roles=read_as().roles))


def load(
    path: str,
    warns: bool = True,
    face: str | None = None,
    face_offset: float = 0.0,
    read: ReadAs | None = None,
) -> Clip:
    """Read the clip in a file as the current command says. ``warns``: whether to warn about parts of the file that are
    left out or changed. ``face``, ``face_offset``, ``read``: as in ``formats.load``.
    """
    read = replace(read or read_as(), rest_frame=None)
    clip = formats.load(path, limits(), face=face, face_offset=face_offset, read=read)
    if warns and (clip.left_out or clip.notes):
        from signsplice.rig.inspection import left_out_warnings

        warn(left_out_warnings(clip))
    return apply_rest_pose(clip)


def apply_rest_pose(clip: Clip) -> Clip:
    """Return a clip whose rest pose is the frame that the current command names, by default the first that shows a
    person. A clip that has a rest pose, or whose zero pose shows a person, stays as it is. Warns if its zero
    pose shows a person and ``--rest-frame`` is given.
    """
    from signsplice.rig.rest_pose import rests_as_person, with_rest_pose

    frame = _option_value("rest_frame")
    if frame is not None and rests_as_person(clip.skeleton):
        warn([f"{clip.name}: its zero pose shows a person; --rest-frame is not for it"])
    return with_rest_pose(clip, frame)


_FACE = (
    "Face of a clip: a CSV of ARKit's coefficients, or a clip with one; may be repeated.  [default: NAME.csv "
    "beside NAME.bvh]"
)
_FACE_OFFSET = "Seconds from a clip's first frame to its face's first row or frame."
reads_faces = combine_options(
    option("--face faces", "FACE.csv", _FACE, multiple=True),
    option("--face-offset", "S", _FACE_OFFSET, type=float, default=0.0),
)
"""Options of commands that give clips a face."""


def faces_of(clips: Sequence[str], faces: Sequence[str]) -> list[str | None]:
    """Return the face of each clip: the file of the same name, None without one; where not all faces find a clip by
    name: by order, one for each. Raises ``InputError`` if that fails too.
    """
    by_name = {Path(face).stem.casefold(): face for face in faces}
    matched = [by_name.get(Path(clip).stem.casefold()) for clip in clips]
    if len({*matched} - {None}) == len(faces):
        return matched
    if len(faces) != len(clips):
        raise InputError(
            f"{len(faces)} --face for {len(clips)} clips, expected one for each, or files named like the clips"
        )
    return list(faces)


def load_avatar(path: str, roles: Mapping[str, str] | None = None, skin: Sequence[str] = ()) -> Avatar:
    """Read the avatar in a file; ``roles``: as in ``ReadAs``, ``skin``: names of its parts that are skin."""
    from signsplice.formats.avatar import read_avatar

    return read_avatar(path, roles, limits(), skin)


def with_figure(clip: Clip, path: str, output: str) -> Clip:
    """Return a clip with the figure in its file, if the output is a picture, which shows it; warn of a figure that
    cannot be read.
    """
    if Path(output).suffix.lower() not in PICTURE_SUFFIXES:
        return clip
    from signsplice.formats import avatar

    try:
        return avatar.with_figure(clip, path, limits())
    except FormatError as error:
        warn([f"{error}; the mannequin is drawn instead"])
        return clip


def read_roles(path: str | None) -> dict[str, str] | None:
    """Read role -> joint name from a file; None without a file."""
    from signsplice.formats import roles as roles_file

    return None if path is None else roles_file.read(path)


def check_outputs(output: str, report: str | None = None, inputs: Iterable[str | Path | None] = ()) -> None:
    """Raise ``InputError``, before any work, for an unknown suffix, a report named like the output, and outputs that
    are unwritable or among ``inputs``; warn of hard links.
    """
    if Path(output).suffix.lower() not in PICTURE_SUFFIXES:
        formats.check_suffix(output)
    if report is not None and Path(report).resolve() == Path(output).resolve():
        raise InputError(f"{report}: named for both the animation and the report, expected two names")
    inputs = list(inputs)
    for path in (output, report):
        if path is not None:
            check_output(path, inputs)
    if Path(output).suffix.lower() == ".bvh":  # a face is written beside it
        sidecars = [Path(source).with_suffix(".csv") for source in inputs if source and Path(source).suffix]
        check_apart(str(Path(output).with_suffix(".csv")), [*inputs, *sidecars])


def check_skin(skin: Sequence[str], avatar: str | None) -> None:
    """Raise ``InputError`` for names of skin without an avatar."""
    if skin and avatar is None:
        raise InputError("--skin names meshes of an avatar, expected --avatar too")


def parse_size(output: str, view: str, size: str | None) -> tuple[int, int] | None:
    """Parse the size of a film. Raises ``InputError``, before any work, for options that an output does not have."""
    if Path(output).suffix.lower() not in PICTURE_SUFFIXES and (view != "front" or size is not None):
        raise InputError(f"{output}: --view and --size are for pictures: {', '.join(PICTURE_SUFFIXES)}")
    expected = f"--size {size!r}, expected WIDTHxHEIGHT in pixels, e.g. 1920x1080"
    return None if size is None else two_numbers(size.lower(), "x", expected)


def check_output(path: str, inputs: Iterable[str | Path | None]) -> None:
    """Raise ``InputError`` for an output that cannot be written or is one of ``inputs``; warn if it has further hard
    links, which keep the old content.
    """
    check_writable(path)
    check_apart(path, inputs)
    n_names = Path(path).stat().st_nlink if Path(path).exists() else 1
    if n_names > 1:
        warn([f"{path}: is one of {n_names} hard links to a file; the others keep the old content"])


def check_apart(output: str, inputs: Iterable[str | Path | None]) -> None:
    """Raise ``InputError`` if an output is one of the inputs or the roles file, by any name or link, a file in an input
    folder, or a folder that holds an input.
    """
    for source in (*inputs, _option_value("roles")):
        if source and _would_overwrite(Path(output), Path(source)):
            raise InputError(f"{output}: would overwrite what is read from {source}; name another output")


def _would_overwrite(output: Path, source: Path) -> bool:
    try:
        written, read = output.stat(), source.stat()
        if output.is_dir():
            return source.resolve().is_relative_to(output.resolve())
        files = source.iterdir() if source.is_dir() else ()
        return samestat(written, read) or any(samestat(written, file.stat()) for file in files if file.is_file())
    except OSError:  # there is no file to overwrite, or to read
        return False


def report_of(clip: Clip, file: str, path: str | None) -> dict[str, Any] | None:
    """Return the report of the splice that made a clip from ``file``: from ``path``, else the one in the file; None
    without. Warns of one in the file that cannot be used.
    """
    if path is None and clip.report is None:
        return None
    from signsplice.splicing import report as reports

    if path is not None:
        return reports.read(path, len(clip))
    try:
        return reports.check(clip.report, len(clip), f"{file}: its report of a splice")
    except InputError as error:
        warn([f"{error}; left out"])
        return None


def write(
    clip: Clip,
    output: str,
    spans: Spans = (),
    view: str = "front",
    size: tuple[int, int] | None = None,
    warns_of_lost: bool = True,
) -> None:
    """Write a clip by suffix. Pictures mark ``spans`` and are drawn from ``view``; films have a ``size`` in pixels.
    ``warns_of_lost``: whether to warn of parts of a face that the figure cannot show.
    """
    if Path(output).suffix.lower() in PICTURE_SUFFIXES:
        from signsplice.render import film, gpu

        note([] if gpu.renderer() else [gpu.LACK])
        with progress(f"rendering {Path(output).name}") as advance:
            film.write_pictures(clip, output, [film.Mark(*span) for span in spans], view, advance, size)
        return
    formats.save(clip, output)
    if Path(output).suffix.lower() == ".bvh":
        from signsplice.formats.bvh import written_names

        pairs = zip(clip.skeleton.names, written_names(clip), strict=True)
        changed = [f"{name!r} as {written!r}" for name, written in pairs if name != written]
        more = f" and {len(changed) - 3} more" if len(changed) > 3 else ""
        warn([f"{output}: BVH holds no such names of joints: {', '.join(changed[:3])}{more}"] if changed else [])
    if clip.face is None and Path(output).suffix.lower() == ".bvh":
        from signsplice.formats.live_link import sidecar

        if (face_path := sidecar(Path(output))) is not None:
            warn([f"{face_path}: beside {output}, which was written without a face, is another clip's; remove it"])
    # The retargeting has warned of parts that an avatar's own file cannot show.
    is_avatar_file = getattr(clip.skeleton, "file", None) is not None
    if warns_of_lost and not is_avatar_file and clip.face is not None and Path(output).suffix.lower() == ".glb":
        from signsplice.formats.gltf_face import lost_in

        lost = lost_in(output, clip)
        if lost:
            further = f" and {len(lost) - 4} more" if len(lost) > 4 else ""
            warn([f"{output}: its figure cannot show {', '.join(lost[:4])}{further} of the face"])
