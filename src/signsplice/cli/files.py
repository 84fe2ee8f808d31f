"""Commands on one file: inspect it, convert it, draw it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from signsplice.cli.clips import (
    PICTURES,
    SKIN,
    check_outputs,
    check_skin,
    faces_of,
    load,
    load_avatar,
    load_body,
    parse_size,
    read_as,
    reads_clips,
    reads_faces,
    report_of,
    with_figure,
    write,
)
from signsplice.cli.options import AS_JSON, option
from signsplice.cli.terminal import one_line, warn
from signsplice.errors import InputError
from signsplice.render import PICTURE_SUFFIXES

if TYPE_CHECKING:
    from signsplice.motion import Clip


@click.command()
@click.argument("file", metavar="FILE")
@AS_JSON
@reads_clips
def inspect(file: str, as_json: bool) -> None:
    """Show a clip's rig, roles found, rate, frames, units, rest spans and warnings."""
    from signsplice.body.collision import depth_warnings
    from signsplice.rig.inspection import inspect as inspect_clip

    clip = load(file, warns=False)
    facts = inspect_clip(clip, file)
    facts["warnings"] += depth_warnings(clip)
    if clip.points is not None:
        from signsplice.body.landmarks import measure_fit

        facts["landmarks"] = [
            f"{group.name}: {group.points} points, {group.seen:.0%} seen"
            + ("" if group.pixels is None else f", {group.pixels:g} pixels from the fitted pose")
            for group in measure_fit(clip)
        ]
    if as_json:
        print(json.dumps(facts, indent=2, ensure_ascii=False))
        return
    for key, value in facts.items():
        if key == "roles":
            print(f"roles      {len(value)} found")
            for role, joint in value.items():
                print(f"           {role:24} {one_line(joint)}")
        elif isinstance(value, list):
            print(f"{key:10} {'none' if not value else ''}".rstrip())
            for line in value:
                print(f"           {one_line(line)}")
        else:
            print(f"{key:10} {one_line(str(value))}")


@click.command()
@click.argument("source", metavar="IN")
@click.argument("output", metavar="OUT")
@option("--onto", "RIG", "Clip whose body the motion is brought to: places and contacts are kept.")
@option("--avatar", "A.vrm", "Avatar (.vrm, .glb, .fbx) that the motion is brought to; a .glb is its own file.")
@SKIN
@option("--report", "R.json", "With --onto or --avatar: write what the hands touch, before and after.")
@option("--mouth", "SAMPA", 'Sounds that the mouth says over the sign, in SAMPA: "h@l@U".')
@reads_faces
@reads_clips
def convert(
    source: str,
    output: str,
    onto: str | None,
    avatar: str | None,
    skin: tuple[str, ...],
    report: str | None,
    mouth: str | None,
    faces: tuple[str, ...],
    face_offset: float,
) -> None:
    """Turn one file into another, by suffix; with --onto or --avatar, for another body."""
    if onto is not None and avatar is not None:
        raise InputError("--onto and --avatar each name a body, expected one of them")
    check_skin(skin, avatar)
    body = onto if avatar is None else avatar
    if report is not None and body is None:
        raise InputError("--report describes what --onto does, or --avatar, expected one of them too")
    if Path(output).suffix.lower() == ".vrm":
        raise InputError(f"{output}: an avatar is not written; name a .vrma, .glb or .bvh")
    check_outputs(output, report, inputs=[source, body, *faces])
    # The retargeting warns of the clip itself.
    clip = load(source, warns=body is None, face=faces_of([source], faces)[0], face_offset=face_offset)
    if clip.points is not None and Path(output).suffix.lower() not in (".pose", ".npz"):
        from signsplice.body.landmark_fit import DEPTH_NOTE

        warn([DEPTH_NOTE])
    if mouth is not None:
        clip = _mouthing(clip, mouth)
    if body is None:
        write(with_figure(clip, source, output), output)
        print(f"{output}: {len(clip)} frames, {clip.seconds:.2f} s")
        return
    from signsplice.body.capsules import body_capsules
    from signsplice.body.contacts import count_kept
    from signsplice.body.retarget import retarget

    done = retarget(clip, load_body(body) if avatar is None else load_avatar(body, read_as().roles, skin))
    warn(done.warnings)
    write(done.clip, output)
    if report is not None:
        from signsplice.splicing import report as reports

        reports.write(reports.describe_retargeting(done, source, body), report)
    kept = count_kept(done.contacts, body_capsules(done.clip.skeleton))
    print(f"{output}: {len(done.clip)} frames, {done.clip.seconds:.2f} s, {kept}")


def _mouthing(clip: Clip, sampa: str) -> Clip:
    """Return a clip whose mouth says sounds during the frames that a splice keeps."""
    from signsplice.splicing import options as choice
    from signsplice.splicing.contracts import cut_clips
    from signsplice.written.nonmanual import with_mouthing

    (cut,) = cut_clips(choice.choose(None, None, None, None).cutter, [clip, clip])
    frames = (cut.post, cut.pre + 1) if cut.post < cut.pre else (0, len(clip))
    return with_mouthing(clip, sampa, frames)


@click.command()
@click.argument("source", metavar="IN")
@click.argument("output", metavar=f"OUT.({'|'.join(suffix[1:] for suffix in PICTURE_SUFFIXES)})")
@option("--report", "R.json", "Report of the splice, if it is not in the file.")
@option("--avatar", "A.vrm", "Avatar (.vrm, .glb, .fbx) that signs.  [default: the figure in IN, else the house's]")
@SKIN
@PICTURES
@reads_clips
def render(
    source: str,
    output: str,
    report: str | None,
    avatar: str | None,
    skin: tuple[str, ...],
    view: str,
    size: str | None,
) -> None:
    """Draw the signer: a contact sheet (.png), or a film (.gif, .mp4)."""
    if Path(output).suffix.lower() not in PICTURE_SUFFIXES:
        expected = f"expected a name that ends in {', '.join(PICTURE_SUFFIXES)}"
        raise InputError(f"{output}: {expected}; use convert for other files")
    check_skin(skin, avatar)
    check_outputs(output, inputs=[source, report, avatar])
    film_size = parse_size(output, view, size)
    clip = load(source, warns=avatar is None)
    stored = report_of(clip, source, report)
    rows = [] if stored is None else stored["spans"]
    spans = [(span["kind"], span["name"] or "", *span["output"]) for span in rows]
    if avatar is None:
        clip = with_figure(clip, source, output)
    else:
        from signsplice.body.retarget import retarget

        done = retarget(clip, load_avatar(avatar, read_as().roles, skin))
        warn(done.warnings)
        clip = done.clip
    write(clip, output, spans, view, film_size)
    print(f"{output}: {len(clip)} frames, {clip.seconds:.2f} s")


COMMANDS = (render, inspect, convert)
