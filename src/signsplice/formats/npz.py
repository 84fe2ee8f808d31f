"""NumPy archives (``.npz``): the arrays of a clip unchanged, quick to open."""

from __future__ import annotations

import json
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import FormatError, InputError
from signsplice.formats.atomic import read_bytes
from signsplice.motion.clip import Clip, EndSite, Skeleton
from signsplice.motion.euler_channels import Channels

VERSION = 1
MAX_EXPANSION = 200
"""An archive may unpack to this many times its own size (at least 64 MiB): clips stay far below, zip bombs do not."""


def encode(clip: Clip) -> bytes:
    """The bytes of an archive with every array of a clip."""
    skeleton = clip.skeleton
    channels = None if clip.channels is None else clip.channels.settled()
    head: dict[str, Any] = {
        "version": VERSION,
        "name": clip.name,
        "fps": clip.fps,
        "names": skeleton.names,
        "end_joints": [site.joint for site in skeleton.end_sites],
        "roles": dict(skeleton.roles) if skeleton.roles is not None else None,
    }
    arrays = {
        "parents": skeleton.parents,
        "offsets": skeleton.offsets,
        "end_offsets": np.array([site.offset for site in skeleton.end_sites]).reshape(-1, 3),
        "local_rotations": clip.local_rotations,
        "root_positions": clip.root_positions,
    }
    if clip.translations is not None:
        arrays["translations"] = clip.translations
    if channels is not None:
        head |= {"channels": channels.names, "frame_time": channels.frame_time, "starts": channels.starts}
        arrays |= {"channel_values": channels.values, "channel_offsets": channels.offsets}
    archive = BytesIO()
    np.savez_compressed(archive, head=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]
    return archive.getvalue()


def read(path: str | Path) -> Clip:
    """The clip in an archive that ``encode`` made. Raises ``FormatError`` for any other, ``InputError`` if it cannot be
    read.
    """
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > max(64 << 20, MAX_EXPANSION * len(content)):
            raise FormatError(f"unpacks to {unpacked >> 20} MiB, far more than a clip does; refused", file=str(path))
        with np.load(BytesIO(content), allow_pickle=False) as stored:
            arrays = {key: stored[key] for key in stored.files}
        return _clip(arrays)
    except FormatError:
        raise
    except InputError as error:
        raise FormatError(f"holds no valid clip ({error})", file=str(path)) from error
    except (zipfile.BadZipFile, ValueError, KeyError, TypeError, EOFError, OSError, IndexError, MemoryError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"is not a clip that signsplice wrote ({reason})", file=str(path)) from error


def _clip(arrays: dict[str, Any]) -> Clip:
    head = json.loads(str(arrays["head"]))
    if head["version"] != VERSION:
        raise InputError(f"version {head['version']}, expected {VERSION}")
    channels = None
    if "channels" in head:
        channels = Channels(
            names=tuple(tuple(row) for row in head["channels"]),
            values=arrays["channel_values"],
            offsets=arrays["channel_offsets"],
            frame_time=float(head["frame_time"]),
            starts=tuple(head["starts"]),
        )
    skeleton = Skeleton(
        names=tuple(head["names"]),
        parents=arrays["parents"],
        offsets=arrays["offsets"],
        end_sites=tuple(
            EndSite(int(joint), offset) for joint, offset in zip(head["end_joints"], arrays["end_offsets"], strict=True)
        ),
        roles=head["roles"],
    )
    return Clip(
        skeleton=skeleton,
        local_rotations=arrays["local_rotations"],
        root_positions=arrays["root_positions"],
        fps=head["fps"],
        name=head["name"],
        translations=arrays.get("translations"),
        channels=channels,
    )
