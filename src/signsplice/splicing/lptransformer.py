"""LpTransformer on clips of any rig: the paper's positions, Culling, frames and filter, run by onnxruntime.

Huang, Xing, Shen and Fan, "Sign Language Animation Splicing Model Based on LpTransformer Network", Computer Science
50(9), 2023. Its parts:

    numbers of a frame          ``numbers_of``: positions of 53 joints, in [-0.5, 0.5]
    SPSN, eq. 4 to 9            ``LpTransformer.token_logits``, the graph spsn.onnx
    splice positions, eq. 10    ``splice_positions``
    Culling, eq. 11             ``cull``
    TFGN, eq. 12 to 16          ``LpTransformer.new_frames``, the graphs encoder.onnx and decoder.onnx
    Filter, eq. 17              ``WholeSystem.filled_seam``; ``engine`` joins the pieces

The networks know the bodies of synthetic signers. A clip's rotations are brought to the standard body
(``on_standard_body``) and the new frames back from it (``rig_clip``), so any clip with named arms can be spliced.
LPT+ has another network for the positions, which reads each word alone, and the same parts after it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.motion.cache import CACHE
from signsplice.rig.info import canonical_motion, with_canonical_rotations
from signsplice.signer.signer import STATURE_CM, skeleton
from signsplice.splicing.bundle import BUNDLE_FILE, WEIGHTS, Array, Sessions, bundle_sha256, config_errors, read_config
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import find_transition
from signsplice.splicing.from_positions import clip_of_positions
from signsplice.splicing.learned import SYSTEM
from signsplice.splicing.seam import Seam
from signsplice.splicing.systems import WholeSystem
from signsplice.splicing.word import AlignedWord

NONE, PRE, POST = 0, 1, 2
"""Classes of a frame: no token, prePositionToken, postPositionToken."""
START, HIDDEN = 0, 2
"""Kinds of a decoder's input: preIndexToken; a frame that it makes in the same pass. 1, a frame fed back, is not used
here.
"""
EXTENT = 1.3
"""Side of the cube, in statures, that is scaled to [-0.5, 0.5]^3: wide enough for every reach."""


def splice_positions(logits: NDArray[np.float32], n_before: int, bias: float = 0.0) -> tuple[int | None, int | None]:
    """Positions from logits (N + M, 3) (eq. 10): pre, a frame of the word before (N frames, ``n_before``), and post,
    counted from the first frame of the word after; None for a token whose class wins at no frame. A position is the
    frame with the highest log-odds against "none".

    bias: added to the logits of both tokens first.
    """
    wins = (logits + np.array([0.0, bias, bias])).argmax(axis=1)
    pre = int((logits[:n_before, PRE] - logits[:n_before, NONE]).argmax()) if (wins == PRE).any() else None
    post = int((logits[n_before:, POST] - logits[n_before:, NONE]).argmax()) if (wins == POST).any() else None
    return pre, post


def cull(before: Array, after: Array, pre: int, post: int, fr: int) -> tuple[Array, NDArray[np.bool_]]:
    """The culled frames X_c (2 fr, K), and which of its rows are real frames (2 fr,): the ``fr`` frames up to and with
    ``pre``, and the ``fr`` frames from ``post`` on (eq. 11; its last index is printed as post - fr + 1 and read as
    post + fr - 1).

    before, after: frames (N, K) and (M, K). Where one has fewer, its edge frame is repeated, and the mask is False.
    Raises ``InputError`` for a position outside them.
    """
    if not (0 <= pre < len(before) and 0 <= post < len(after)):
        raise InputError(
            f"splice position {pre}, {post} in clips of {len(before)} and {len(after)} frames, expected frames of them"
        )
    if fr < 1:
        raise InputError(f"fr {fr}, expected at least 1 frame on each side")
    left, right = np.arange(pre - fr + 1, pre + 1), np.arange(post, post + fr)
    rows = np.concatenate([before[np.maximum(left, 0)], after[np.minimum(right, len(after) - 1)]])
    return rows, np.concatenate([left >= 0, right < len(after)])


def decode(graphs: Sessions, encoded: Mapping[str, Array], most_frames: int, n_numbers: int) -> dict[str, Array]:
    """What the decoder gives for all frames in one pass: ``made`` (1, n, K), and ``last`` (1, n), the logit that a
    frame is the last one.

    encoded: the encoder's outputs.
    """
    inputs = {name: value for name, value in encoded.items() if name.startswith(("memory", "state"))}
    kinds = np.full((1, most_frames), HIDDEN)
    kinds[:, 0] = START
    blank = np.zeros((1, most_frames, n_numbers), np.float32)
    return graphs.run("decoder", {**inputs, "fed": blank, "kinds": kinds, "start": np.array(0)})


def as_batch_of_one(x: Array) -> Array:
    """Frames (N, K) as a batch of one, in float32."""
    return np.ascontiguousarray(x[None], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class SplicePrediction:
    """What a system predicts for two words.

    pre: last frame kept of the word before; None where it is not found.
    post: first frame kept of the word after; None where it is not found.
    frames: the numbers (n, K) of the new frames.
    warnings: what a user should know, one line each.
    """

    pre: int | None
    post: int | None
    frames: FloatArray
    warnings: tuple[str, ...] = ()

    @property
    def has_frames(self) -> bool:
        """Whether there are new frames between two positions."""
        return self.pre is not None and self.post is not None and len(self.frames) > 0


class JointPositionSplicer(WholeSystem):
    """A system that reads joint positions, on clips of any rig; ``predict_splice`` does the work."""

    learned = True

    @abstractmethod
    def predict_splice(self, before: FloatArray, after: FloatArray) -> SplicePrediction:
        """The splice of two words' numbers (N, 159) and (M, 159)."""

    def splice_words(self, before: AlignedWord, after: AlignedWord) -> Seam:
        """The seam at the predicted positions, filled with the predicted frames on the clips' rig. Raises
        ``NoSpliceError`` as ``filled_seam`` does: where a position is missing, for example.
        """
        clips_on_body = on_standard_body(before.clip), on_standard_body(after.clip)
        spliced = self.predict_splice(numbers_of(clips_on_body[0]), numbers_of(clips_on_body[1]))
        new_clip = None
        if spliced.has_frames:
            kept_before, kept_after = slice((spliced.pre or 0) + 1), slice(spliced.post, None)
            on_body = clip_of_positions(
                positions_of(spliced.frames), clips_on_body[0][kept_before], clips_on_body[1][kept_after]
            )
            new_clip = rig_clip(on_body, before.clip[kept_before], after.clip[kept_after])
        return self.filled_seam(before, after, spliced.pre, spliced.post, new_clip, spliced.warnings)


class LpTransformer(JointPositionSplicer):
    """SPSN for the positions and TFGN for the frames, as exported graphs: LpTransformer, and LPT+.

    graphs: spsn, encoder and decoder.
    fr: frames that Culling keeps on each side.
    most_frames: most frames that are made.
    token_bias: added to the logits of both tokens.
    """

    def __init__(self, graphs: Sessions, sha256: str | None = None) -> None:
        stored = graphs.config.stored
        self.graphs, self.sha256 = graphs, sha256
        for key in ("system", "fps", "fr", "runs"):
            if stored.get(key) is None:
                raise InputError(f"{graphs.config.path}: has no {key!r}; export the system anew")
        with config_errors(graphs.config.path):
            runs = stored["runs"]
            self.name, self.fps, self.fr = str(stored["system"]), float(stored["fps"]), int(stored["fr"])
            self.most_frames, self.token_bias = int(runs["most_frames"]), float(runs.get("token_bias", 0.0))
        self.summary = SHIPPED.get(self.name, f"{self.name} of the paper, trained on corpus {stored.get('corpus')}")
        self.facts = {name: stored.get(name) for name in _FACTS} | {"token_bias": self.token_bias}

    def token_logits(self, before: FloatArray, after: FloatArray) -> NDArray[np.float32]:
        """The logits (N + M, 3) of no token, prePositionToken and postPositionToken (SPSN, eq. 4 to 9)."""
        x = np.concatenate([before, after])
        inputs = {"x": as_batch_of_one(x), "n_before": np.array([len(before)])}
        return np.asarray(self.graphs.run("spsn", inputs, tokens=(1, len(x), 3))["tokens"][0])

    def new_frames(self, culled: Array, mask: NDArray[np.bool_]) -> FloatArray:
        """The frames (n, 159) between two words, of what Culling keeps of them (TFGN, eq. 12 to 16): up to the first
        that is classified as the last one.
        """
        inputs = {"x": as_batch_of_one(culled), "mask": mask[None], "n_before": np.array([self.fr])}
        decoded = decode(self.graphs, self.graphs.run("encoder", inputs), self.most_frames, culled.shape[1])
        ends = np.flatnonzero(decoded["last"][0] > 0.0)
        return decoded["made"][0, : int(ends[0]) + 1 if len(ends) else self.most_frames].astype(np.float64)

    def predict_splice(self, before: FloatArray, after: FloatArray) -> SplicePrediction:
        """The splice of two words' numbers (N, 159) and (M, 159)."""
        pre, post = splice_positions(self.token_logits(before, after), len(before), self.token_bias)
        if pre is None or post is None:
            return SplicePrediction(pre, post, np.zeros((0, before.shape[1])))
        frames = self.new_frames(*cull(before, after, pre, post, self.fr))
        line = f"{self.name} stopped after {len(frames)} frames, the most that it makes: it gave no sign of an end"
        return SplicePrediction(pre, post, frames, (line,) if len(frames) == self.most_frames else ())


SHIPPED = {
    "lptransformer": "LpTransformer (Huang et al. 2023): positions by SPSN, frames by TFGN",
    "lpt-plus": "LPT+: positions by a network that reads each word alone, frames by TFGN",
}
"""Systems that ship, in folders of ``WEIGHTS`` with these names."""
_FACTS = ("scale", "optimiser", "split", "seed", "corpus")


def on_standard_body(clip: Clip) -> Clip:
    """The clip's trunk, arms and hands on the standard synthetic signer, who stands still. Raises ``InputError`` where
    the clip's arms are not known by name.
    """
    body, n_frames = skeleton(), len(clip)
    rest = Clip(
        skeleton=body,
        local_rotations=np.broadcast_to(rotation.IDENTITY, (n_frames, len(body), 4)),
        root_positions=np.broadcast_to(body.offsets[0], (n_frames, 3)),
        fps=clip.fps,
        name=clip.name,
    )
    return with_canonical_rotations(rest, canonical_motion(clip).quats)


def numbers_of(body_clip: Clip) -> FloatArray:
    """The numbers (T, 159) of a clip on the standard signer: cm from the middle of the body's height, divided by
    ``EXTENT`` times the stature.
    """
    middle = np.array([0.0, 0.5 * STATURE_CM, 0.0])
    positions = kinematics.forward(body_clip)[1]  # (T, 53, 3)
    return np.asarray(((positions - middle) / (EXTENT * STATURE_CM)).reshape(len(positions), -1))


def positions_of(numbers: FloatArray) -> FloatArray:
    """The joint positions (T, 53, 3), cm, of numbers (T, 159)."""
    return np.asarray(numbers.reshape(len(numbers), -1, 3) * EXTENT * STATURE_CM + [0.0, 0.5 * STATURE_CM, 0.0])


def rig_clip(new_clip: Clip, before: Clip, after: Clip) -> Clip:
    """New frames of the standard signer as frames between two clips of another rig. Root, legs and joints that the
    standard signer lacks are interpolated linearly from the one to the other.
    """
    straight = find_transition("linear").between(Gap(before, after, len(new_clip)))
    turned = with_canonical_rotations(straight, canonical_motion(new_clip).quats)
    joined = rotation.continuous(np.concatenate([before.local_rotations[-1:], turned.local_rotations]))
    return replace(turned, local_rotations=joined[1:])


GROUP = "signsplice.systems"
"""Entry points of other distributions, each a function that opens a folder: it returns a ``WholeSystem``, or raises
``InputError`` for a folder that is none of its systems.
"""


def open_system(named: str | Path) -> WholeSystem:
    """A system that ships, by name, or the trained system in a folder; its graphs are read on first use. One of
    ``SHIPPED`` is opened once.

    Raises ``InputError`` for a folder that holds no system which an installed distribution opens.
    """
    if named in SHIPPED:
        return CACHE.recent(_open_graphs, WEIGHTS / named, most=len(SHIPPED))
    folder = Path(named)
    try:
        is_bundle = (folder / BUNDLE_FILE).is_file()
        within = [] if is_bundle else sorted(path.parent.name for path in folder.glob(f"*/{BUNDLE_FILE}"))
    except OSError as error:  # a name that is too long
        raise InputError(f"{str(folder)[:80]}: cannot be read ({error.strerror})") from error
    if not is_bundle:
        known = f"name one of those in it: {', '.join(within)}" if within else f"those that ship: {', '.join(SHIPPED)}"
        raise InputError(f"{folder}: is no trained system; {known}")
    config = read_config(folder)
    if config.system == SYSTEM:
        raise InputError(f"{folder}: is a bundle of this project's networks; give it as SpliceOptions.bundle")
    if _is_lptransformer(config.stored):
        return _open_graphs(folder)
    refusal = InputError(f"{folder}: a system that signsplice-paper opens: install it (pip install ./research)")
    for entry in entry_points(group=GROUP):
        try:
            system: WholeSystem = entry.load()(folder)
            return system
        except InputError as error:
            refusal = error
    raise refusal


def _open_graphs(folder: Path) -> LpTransformer:
    return LpTransformer(Sessions(folder, read_config(folder)), bundle_sha256(folder))


def _is_lptransformer(stored: Mapping[str, Any]) -> bool:
    """Whether a bundle.json is of a system with positions by SPSN and frames in one pass (``concurrent``), made from
    the frames that Culling keeps (``fr``; not from ``marked`` words), on the standard signer's body (no ``space``).
    """
    runs = stored.get("runs") or {}
    is_one_pass = runs.get("positions") == "spsn" and runs.get("concurrent") and not runs.get("marked")
    return bool(is_one_pass) and stored.get("fr") is not None and stored.get("space") is None
