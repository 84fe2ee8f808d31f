"""Agreement of a corpus's figures with real ones, in three parts, and the list of what misses."""

from __future__ import annotations

import pytest

from signsplice_workshop.measure.measures import HEAD, Quantity, format_quantities, list_misses

FIVE = (160.0, 200.0, 250.0, 320.0, 480.0)


def quantity(ours: tuple[float, ...], real: tuple[float, ...], spread: bool = False) -> Quantity:
    return Quantity("q", "ms", ours, real, "nobody", spread)


@pytest.mark.parametrize(
    ("ours", "agreement"),
    [
        ((160.0, 0.0, 250.0, 0.0, 480.0), (True, True, True)),
        ((199.0, 0.0, 287.0, 0.0, 599.0), (True, True, True)),
        ((201.0, 0.0, 288.0, 0.0, 601.0), (False, False, False)),
        ((121.0, 0.0, 213.0, 0.0, 361.0), (True, True, True)),
        ((119.0, 0.0, 212.0, 0.0, 359.0), (False, False, False)),
        ((160.0, 0.0, 250.0, 0.0, 359.0), (True, True, False)),
    ],
)
def test_medians_agree_within_15_percent_and_tails_within_25(
    ours: tuple[float, ...], agreement: tuple[bool, bool, bool]
) -> None:
    assert quantity(ours, FIVE).agreement == agreement


def test_what_is_not_known_does_not_count() -> None:
    five = (1.0, 2.0, 0.5, 4.0, 5.0)
    assert quantity(five, (0.5,)).agreement == (True, None, None)
    assert quantity((90.0,), (100.0,)).agreement == (True, None, None)
    assert quantity((80.0,), (100.0,)).agreement == (False, None, None)
    assert quantity((90.0,), FIVE).agreement == (False, None, None)


def test_a_range_is_of_medians_or_a_spread() -> None:
    ours = (0.995, 0.999, 1.0, 1.01, 1.03)
    assert quantity(ours, (0.6, 1.0)).agreement == (True, None, None)
    assert quantity(ours, (0.6, 1.0), spread=True).agreement == (True, False, True)
    assert quantity((1.0, 1.0, 0.53, 1.0, 1.0), (0.42, 0.47)).agreement[0]
    assert not quantity((1.0, 1.0, 0.55, 1.0, 1.0), (0.42, 0.47)).agreement[0], "15 % from the nearer end"
    assert quantity(ours, (0.5, 1.5)).ratio == pytest.approx(1.0)
    assert quantity((275.0,), FIVE).ratio == pytest.approx(1.1)


def test_the_table_says_which_parts_agree_and_what_misses() -> None:
    rows = [
        Quantity("transition", "ms", (160.0, 200.0, 250.0, 320.0, 300.0), FIVE, "Czech SL"),
        Quantity("head", "degrees/s", (2.0,), (90.0,), "a take"),
        Quantity("peak", "m/s", (1.0, 1.0, 1.0, 1.0, 1.0), (1.0,), "words"),
    ]
    lines = format_quantities(rows)
    assert lines[0] == f"| {' | '.join(HEAD)} |"
    assert [line.rsplit("|", 2)[1].strip() for line in lines[2:5]] == ["yes / yes / no", "no / - / -", "yes / - / -"]
    assert lines[3] == "| head | degrees/s | 2 | 90 | a take | 0.02 | no / - / - |"
    assert lines[6:] == [
        "1 of 3 rows agree in all that can be compared. Still misses:",
        "",
        "- transition (Czech SL): 95 %",
        "- head (a take): figure",
    ]
    assert list_misses(rows[2:]) == ["1 of 1 rows agree in all that can be compared."]
