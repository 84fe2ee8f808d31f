"""An avatar's own file, kept so that motion can be written into it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from signsplice.motion.arrays import FloatArray
from signsplice.motion.face import LookAt


@dataclass(frozen=True)
class FaceControl:
    """What moves an avatar's face: an expression of VRM, or one morph target.

    name: its name in the file.
    binds: node, number of the morph target, and weight there with the control at 1.
    """

    name: str
    binds: tuple[tuple[int, int, float], ...]


@dataclass(frozen=True, eq=False)
class AvatarFile:
    """The file that an avatar was read from, and where its J joints are in it.

    content: a whole .glb file: it names no other.
    nodes: (J,) the node of each joint.
    turn: (3, 3) from the file's world to the avatar's axes: VRM 0.x avatars face -Z, ours +Z.
    worlds: (J, 4, 4) the joints at rest in the file's world.
    above: (4, 4) what the root hangs on.
    face: what moves its face.
    n_targets: node -> number of morph targets, of the nodes that the face moves.
    expressions: names of the expressions of VRM that move a target, presets as VRM 1.0 has them.
    look_at: how eyes that are bones turn; None where the gaze moves none.
    opens_jaw: whether the jaw is a bone and no morph target opens the mouth.
    """

    content: bytes
    nodes: tuple[int, ...]
    turn: FloatArray
    worlds: FloatArray
    above: FloatArray
    face: tuple[FaceControl, ...] = ()
    n_targets: Mapping[int, int] = field(default_factory=dict)
    expressions: tuple[str, ...] = ()
    look_at: LookAt | None = None
    opens_jaw: bool = False
