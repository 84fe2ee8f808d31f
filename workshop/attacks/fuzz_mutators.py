"""Mutates bytes, text and JSON: each function returns the bytes of another file, chosen by a random generator alone."""

from __future__ import annotations

import copy
import json
import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

Mutator = Callable[[bytes, random.Random], bytes]

INTEGERS = (-(2**63), -(2**31), -65536, -2, -1, 0, 1, 2, 3, 7, 255, 256, 65535, 65536, 2**20, 2**31 - 1, 2**31,
            2**32 - 1, 2**53, 2**62, 2**63 - 1, 2**63, 2**64)  # fmt: skip
FLOATS = (0.0, -0.0, 1e-300, -1e-6, 1e-6, 0.5, 1.5, 1e6, 160_000.0, 1e20, 1e39, 1e300, -1e300, 5e-324)
WORDS = ("", " ", "nan", "inf", "-inf", "1e999", "-1e999", "1e-999", "0x10", "1_0", "1,5", "-", "+", ".", "e5", "٣",
         "é", "\0", "\u2028", "\x85", "\ud800", "😀", "null", "{", "}", "[", "]", '"', "=", ":", "#", "..", "/dev/zero",
         "-1", "0", "1", "2", "999999999999", "9" * 30, "9" * 5000, "a" * 5000, "%s", "\x1b[31m")  # fmt: skip
RAW_JSON = ("NaN", "Infinity", "-Infinity", "1e999", "-0", "9" * 5000, "0." + "9" * 5000, "[" * 2000 + "]" * 2000,
            "[" * 100_000, '{"a":' * 3000 + "1" + "}" * 3000, '{"a": 1, "a": 2}', '"\\ud800"', '"\\u0000"', "tru", "",
            "/* */ 1", "1,", "'a'")  # fmt: skip


def mutate_bytes(content: bytes, rng: random.Random) -> bytes:
    """Returns bytes changed, removed, repeated, moved or added at one place, or cut short."""
    if not content:
        return rng.randbytes(rng.randint(1, 64))
    raw = bytearray(content)
    start = rng.randrange(len(raw))
    size = min(int(2 ** rng.uniform(0, 12)), len(raw) - start)
    match rng.randrange(9):
        case 0:
            raw[start] ^= 1 << rng.randrange(8)
        case 1:
            raw[start] = rng.choice((0, 1, 0x20, 0x30, 0x7F, 0x80, 0xFF, rng.randrange(256)))
        case 2:
            del raw[start : start + size]
        case 3:
            raw[start:start] = raw[start : start + size] * rng.choice((1, 1, 2, 16))
        case 4:
            raw[start : start + size] = rng.randbytes(size)
        case 5:
            del raw[start:]
        case 6:
            target = rng.randrange(len(raw))
            raw[target : target + size] = raw[start : start + size]
        case 7:
            kind = rng.choice(["<H", ">H", "<I", ">I", "<q"])
            limit = 1 << 8 * struct.calcsize(kind)
            value = rng.choice(INTEGERS) % (limit // 2)
            raw[start : start + struct.calcsize(kind)] = struct.pack(
                kind, value - limit * (kind == "<q" and value >= limit // 2)
            )
        case _:
            kind = rng.choice(["<f", "<d"])
            with np.errstate(over="ignore"):
                number = float(np.float32(draw_hostile_float(rng)) if kind == "<f" else draw_hostile_float(rng))
            raw[start : start + struct.calcsize(kind)] = struct.pack(kind, number)
    return bytes(raw)


def mutate_text(content: bytes, rng: random.Random) -> bytes:
    """Returns a text with one word or line changed, removed, repeated or moved; seldom with single bytes mutated."""
    if rng.random() < 0.2 or not content.strip():
        return mutate_bytes(content, rng)
    lines = content.decode("utf-8", "surrogateescape").split("\n")
    line = rng.randrange(len(lines))
    words = lines[line].split(" ")
    word = rng.randrange(len(words))
    match rng.randrange(16):
        case 0 | 1 | 2 | 9 | 10 | 11 | 12 | 13 | 14:
            words[word] = _draw_other_number(words[word], rng)
            lines[line] = " ".join(words)
        case 3:
            words.insert(word, draw_hostile_word(rng))
            lines[line] = " ".join(words)
        case 4:
            del words[word]
            lines[line] = " ".join(words)
        case 5:
            del lines[line]
        case 6:
            lines[line:line] = [lines[line]] * rng.choice((1, 2, 50))
        case 7:
            other_line = rng.randrange(len(lines))
            lines[line], lines[other_line] = lines[other_line], lines[line]
        case _:
            words[word] = rng.choice(rng.choice(lines).split(" "))
            lines[line] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "surrogatepass" if rng.random() < 0.5 else "replace")


def _draw_other_number(word: str, rng: random.Random) -> str:
    """Returns mostly another number for a number; a hostile word for other words."""
    try:
        number = float(word)
    except ValueError:
        return draw_hostile_word(rng)
    is_whole = word.lstrip("-").isdecimal()
    numbers = (number * 1e3, number * 1e-3, -number, number + 1.0, *FLOATS)
    return draw_hostile_word(rng) if rng.random() < 0.3 else format(rng.choice(numbers), ".0f" if is_whole else "")


def mutate_json(content: bytes, rng: random.Random) -> bytes:
    """Returns a JSON document with one value changed, removed, repeated or nested; seldom with single bytes mutated."""
    if rng.random() < 0.1:
        return mutate_bytes(content, rng)
    try:
        value = json.loads(content)
    except (ValueError, RecursionError):
        return mutate_text(content, rng)
    raw: dict[str, str] = {}
    value = mutate_value(value, rng, raw)
    text = json.dumps(value, ensure_ascii=rng.random() < 0.9)
    for mark, raw_text in raw.items():
        text = text.replace(f'"{mark}"', raw_text)
    return text.encode("utf-8", "replace")


def mutate_value(value: Any, rng: random.Random, raw: dict[str, str]) -> Any:
    """Returns a copy of JSON values with one of them changed. ``raw`` collects text that JSON values cannot spell: mark
    that stands for it -> text.
    """
    root = [copy.deepcopy(value)]
    places: list[tuple[Any, Any]] = []
    stack: list[Any] = [root]
    while stack and len(places) < 5000:
        container = stack.pop()
        keys = list(container) if isinstance(container, dict) else range(len(container))
        places += [(container, key) for key in keys]
        stack += [container[key] for key in keys if isinstance(container[key], (dict, list))]
    holder, key = rng.choice(places)
    match rng.randrange(10):
        case 0 if holder is not root:
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[draw_hostile_word(rng) if rng.random() < 0.5 else key + "x"] = holder.pop(key)
        case 2 if isinstance(holder, list) and holder is not root:
            holder[key:key] = [copy.deepcopy(holder[key])] * rng.choice((1, 3, 1000))
        case 3:
            source, name = rng.choice(places)
            holder[key] = copy.deepcopy(source[name])
        case 4:
            holder[key] = [holder[key]] if rng.random() < 0.5 else {"a": holder[key]}
        case 5:
            mark = f"@{len(raw)}@{rng.randrange(10**9)}@"
            raw[mark] = rng.choice(RAW_JSON)
            holder[key] = mark
        case _:
            holder[key] = draw_hostile_value(rng, holder[key])
    return root[0]


def draw_hostile_value(rng: random.Random, old_value: Any = None) -> Any:
    """Returns a value of another type, or an extreme one of the same type."""
    if isinstance(old_value, bool) or rng.random() < 0.3:
        return rng.choice((None, True, False, [], {}, "", 0, -1, 1.5, [None], [[]], {"a": None}, "a"))
    if isinstance(old_value, int) and rng.random() < 0.8:
        return rng.choice(
            (old_value + 1, old_value - 1, -old_value, old_value * 1000, *INTEGERS, float(old_value), str(old_value))
        )
    if isinstance(old_value, float) and rng.random() < 0.8:
        return rng.choice((-old_value, old_value * 1e6, old_value * 1e-6, *FLOATS, str(old_value)))
    return rng.choice((rng.choice(INTEGERS), draw_hostile_float(rng), draw_hostile_word(rng)))


def draw_hostile_float(rng: random.Random) -> float:
    """Returns an extreme number, or no number."""
    return rng.choice((*FLOATS, float("nan"), float("inf"), -float("inf")))


def draw_hostile_word(rng: random.Random) -> str:
    """Returns a word that parsers trip over; long ones are rare."""
    word = rng.choice(WORDS)
    return word if len(word) < 100 or rng.random() < 0.1 else word[:8]


def mutate_floats(content: bytes, rng: random.Random) -> bytes:
    """Returns bytes with some of their float32 numbers changed."""
    raw = bytearray(content)
    if len(raw) < 4:
        return mutate_bytes(content, rng)
    for _ in range(rng.choice((1, 1, 4))):
        offset = 4 * rng.randrange(len(raw) // 4)
        number = rng.choice(
            (draw_hostile_float(rng), struct.unpack_from("<f", raw, offset)[0] * rng.choice((-1.0, 2.0, 1e6)))
        )
        with np.errstate(all="ignore"):
            struct.pack_into("<f", raw, offset, float(np.float32(number)))
    return bytes(raw)
