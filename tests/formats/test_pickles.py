"""Pickles that attack: nothing runs, memory and time stay bounded, and each is refused in one line."""

from __future__ import annotations

import builtins
import os
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from signsplice.errors import InputError
from signsplice.formats import WIRE_SUFFIXES, load, parse, pickles
from signsplice.formats.reading import DEFAULT_LIMITS, NO_LIMITS, format_errors

HINT = "save the poses in an .npz of NumPy arrays"


class Reduced:
    """What pickles as a call of a function."""

    def __init__(self, *reduced: Any) -> None:
        self.reduced = reduced

    def __reduce__(self) -> Any:
        return self.reduced


def reconstruct(shape: Any, content: Any = b"1234") -> Reduced:
    """An array with any state: the pickle of numpy's arrays."""
    reduced: Any = np.zeros(1).__reduce__()
    return Reduced(*reduced[:2], (1, shape, np.dtype("f4"), False, content))


def error_of(content: bytes, path: Path) -> str:
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert len(message) < len(str(path)) + 500
    return message


def dumps(value: Any) -> bytes:
    return pickle.dumps({"smplx": value})


def test_no_function_of_a_pickle_is_called(tmp_path: Path) -> None:
    mark, file = tmp_path / "mark", tmp_path / "a.pkl"
    for function, arguments in ((os.system, (f"touch {mark}",)), (builtins.eval, (f"open({str(mark)!r}, 'w')",))):
        message = error_of(dumps(Reduced(function, arguments)), file)
        assert function.__name__ in message
        assert HINT in message
    for raw in (
        "cos\nsystem\n(S'touch {}'\ntR.", "(S'touch {}'\nios\nsystem\n.", "(cos\nsystem\nS'touch {}'\no.",
    ):  # fmt: skip
        error_of(raw.format(mark).encode(), file)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (Path("a"), "it holds 'pathlib.P"),
        (Reduced(np.ndarray, ((10**12,),)), "it calls 'numpy.ndarray' with arguments that are not admitted"),
        (Reduced(np.dtype, ("f4",), Path), "it holds 'pathlib.Path'"),
        (reconstruct((10**12,)), "the shape of an array is not valid"),
        (reconstruct((10**9,)), "an array has shape (1000000000,) in 4 bytes"),
        (reconstruct((-1,)), "the shape of an array is not valid"),
        (reconstruct((True,)), "the shape of an array is not valid"),
        (reconstruct([1]), "the shape of an array is not valid"),
        (reconstruct((1,), content=[1.0]), "smplx is an array without numbers"),
        (np.array([{}, None]), "smplx is an array without numbers"),
        (np.array(["a"]), "smplx is an array without numbers"),
        (np.zeros((5, 182), int), "smplx is an array of int64, expected an array of floats"),
        ([[0.0] * 182], "smplx is a value of type list, expected an array of floats"),
        ({1, 2}, "it holds the instruction EMPTY_SET"),
        (Reduced(complex, (1, 2)), "it holds 'builtins.complex'"),
    ],
)
def test_what_is_not_admitted_is_named(value: Any, message: str, tmp_path: Path) -> None:
    assert message in error_of(dumps(value), tmp_path / "a.pkl")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x80\x04N.", "it holds a value of type NoneType, expected arrays of SMPL-X by name"),
        (b"\x80\x04}.", "it holds a dict without poses"),
        (b"\x80\x04].", "no frames"),
        (b"\x80\x04]K\x01a.", "it holds a value of type int"),
        (b"\x80\x04r\xff\xff\xff\xff.", "names what is not there"),
        (b"\x80\x04Nr\xff\xff\xff\xff0N.", "it holds a value of type NoneType"),
        (b"Np99999999999999999999\n.", "a key in it is a value of type int"),
        (b"}I-1\nNs.", "a key in it is a value of type int"),
        (b"}NNs.", "a key in it is a value of type NoneType"),
        (b"\x80\x04\x82\x01.", "it holds the instruction EXT1"),
        (b"Pa\n.", "it holds the instruction PERSID"),
        (b"\x80\x04K\x01Q.", "it holds the instruction BINPERSID"),
        (b"\x80\x05\x96" + b"\xff" * 7 + b"\x00abc.", "does not fit together"),
        (b"\x80\x05\x97.", "it holds the instruction NEXT_BUFFER"),
        (b"\x80\x04cnumpy\nndarray\n)\x81.", "it holds the instruction NEWOBJ"),
        (b"\x80\x04cnumpy\nndarray\n}b.", "it holds what 'numpy.ndarray' makes"),
        (b"\x80\x04}}b.", "it sets the state of a value of type dict"),
        (b"\x80\x04}(NNd.", "a key in it is a value of type NoneType"),
        (b"\x80\x04K\x01)R.", "it calls a value of type int"),
        (b"\x80\x04]]\x93.", "it names a function by what is no text"),
        (b"\x80\x04K\x01K\x02a.", "does not fit together"),
        (b"\x80\x04t.", "names what is not there"),
        (b"", "does not fit together"),
        (b"\x80\x04}", "does not fit together"),
        (b"PK\x03\x04", "it is a zip file, as torch.save writes, expected a plain pickle"),
        (b"x\x9c", "it is compressed, expected a plain pickle"),
    ],
)
def test_instructions_that_break_the_machine_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    assert message in error_of(content, tmp_path / "a.pkl")


def test_tensors_beside_the_poses_are_not_read_and_tensors_of_poses_are_named(tmp_path: Path) -> None:
    """SignAvatars' files hold flags as tensors: of a tensor's pickle the bytes of torch.save are an argument."""
    rebuild = (
        b"ctorch._utils\n_rebuild_tensor_v2\n(ctorch.storage\n_load_from_bytes\nC\x01x\x85RK\x00K\x05\x85K\x01\x85\x89"
    )
    tensor = rebuild + b"ccollections\nOrderedDict\n)RtR"
    path, poses = tmp_path / "a.pkl", pickle.dumps(np.zeros((5, 182)), protocol=2)[2:-1]
    path.write_bytes(b"\x80\x03}(X\x0a\x00\x00\x00left_valid" + tensor + b"X\x05\x00\x00\x00smplx" + poses + b"u.")
    assert len(load(path)) == 5
    message = error_of(b"\x80\x03}(X\x05\x00\x00\x00smplx" + tensor + b"u.", path)
    assert f"smplx is what 'torch._utils._rebuild_tensor_v2' makes, expected an array of floats; {HINT}" in message


_MEMOIZED_TEXT = b"\x80\x04X\x00\x00\x10\x00" + b"a" * 2**20 + b"\x940"
_ENCODED = b"c_codecs\nencode\nh\x00\x8c\x06latin1\x86R"
_FRAME = pickle.dumps({"poses": np.zeros(165), "betas": np.zeros(100_000)}, protocol=2)[:-1]


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x04" + b"]" * 2_000_000 + b"a" * 1_999_999 + b".",
        b"\x80\x04" + b"(" * 2_000_000 + b".",
        b"\x80\x04" + b"}\x94" * 1_000_000 + b".",
        b"\x80\x04]" + b"2\x94" * 40 + b"\x86" * 30 + b".",
        b"\x80\x04](K\x01K\x01" + b"e2\x86" * 60 + b".",
        _MEMOIZED_TEXT + _ENCODED * 200 + b".",
        b"\x80\x02]" + _FRAME[2:] + b"q\xf0a" + b"h\xf0a" * 8_000 + b".",
        b"\x80\x02]" + _FRAME[2:] + b"q\xf0a" + b"h\xf0a" * 100_000 + b".",
        pickle.dumps([{"a": [[]] * 1000}] * 1000),
    ],
    ids=["lists", "marks", "dicts", "shared tuples", "growing tuples", "texts", "frames", "many frames", "no poses"],
)
def test_small_pickles_take_no_unbounded_memory(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    tracemalloc.start()
    error_of(content, path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < (64 << 20) + 10 * len(content)


VALID = [
    pickle.dumps(value, protocol=protocol)
    for protocol in (0, 2, 4, 5)
    for value in ({"smplx": np.zeros((2, 182), np.float32), "fps": 25}, [{"body_pose": np.zeros(63)}] * 2)
]


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_damaged_pickles_are_read_or_refused_in_one_line(data: st.DataObject) -> None:
    content = bytearray(data.draw(st.sampled_from(VALID)))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        action = data.draw(st.sampled_from(["change", "cut", "insert", "repeat"]))
        if action == "change":
            content[at] = data.draw(st.integers(0, 255))
        elif action == "cut":
            del content[at : at + data.draw(st.integers(1, 20))]
        elif action == "insert":
            content[at:at] = data.draw(st.binary(min_size=1, max_size=8))
        else:
            content[at:at] = content[at : at + data.draw(st.integers(1, 50))]
        content = content or bytearray(b".")
    refusal = ""
    try:
        with format_errors("a.pkl", ".pkl file"), np.errstate(all="ignore"):
            pickles.parse(bytes(content), "a.pkl", DEFAULT_LIMITS)
    except InputError as error:
        refusal = str(error)
    assert not refusal or refusal.startswith("a.pkl: ")
    assert "\n" not in refusal


def test_limits_can_be_lifted() -> None:
    content = pickle.dumps({"poses": np.zeros((2, 165)), "more": [[]] * 1_000_000})
    with format_errors("a.pkl", ".pkl file"):
        with pytest.raises(InputError, match="its instructions take"):
            pickles.parse(content, "a.pkl", DEFAULT_LIMITS)
        assert len(pickles.parse(content, "a.pkl", NO_LIMITS)) == 2


@pytest.mark.parametrize("suffix", [".pkl", ".npy"])
def test_uploads_are_not_taken(suffix: str) -> None:
    assert suffix not in WIRE_SUFFIXES
    with pytest.raises(InputError, match="cannot be taken"):
        parse(VALID[0], f"a{suffix}")
