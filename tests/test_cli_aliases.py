"""Former spellings of the command line: they do what the present ones do, and note them."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from signsplice.cli.aliases import FormerlyOptions

from signsplice.cli.commands import app
from signsplice_workshop.cli.evaluate import evaluate


def run(*call: str) -> Result:
    return CliRunner().invoke(app, call)


FORMER = {
    "--clips A.bvh --clips B.bvh --fps 24 --json": "clips A.bvh B.bvh --fps 24 --json",
    "--clips=A.bvh --no-limits": "clips A.bvh --no-limits",
    "nets --seams 500 --rest folded": "seams 500 --bundle nets --rest folded",
    "--json nets --joins 3": "seams 3 --json --bundle nets",
    "--pairs out/pairs --limit 3 nets": "pairs out/pairs --limit 3 --bundle nets",
    "--bodies": "bodies",
    "--bodies --json": "bodies --json",
    "--bodies 150 --picture a.png": "bodies 150 --picture a.png",
    "--clips A.bvh --bodies --fps 24": "bodies --fps 24 --clips A.bvh",
    "--tempo 40 nets": "tempo 40 --bundle nets",
    "nets --bodies 3": "bodies 3",
    "--seams 3 --fps 24 --limit 2 --no-limits": "seams 3",
}


@pytest.mark.parametrize(("former", "present"), FORMER.items())
def test_former_words_of_evaluate_are_the_present_ones(
    former: str, present: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert isinstance(evaluate, FormerlyOptions)
    context = evaluate.make_context("evaluate", former.split())
    name, _, rest = context._protected_args[0], None, context.args
    assert [name, *rest] == present.split()
    assert capsys.readouterr().err == f"note: this call is now: signsplice evaluate {present}\n"


def test_present_words_pass_without_a_note(capsys: pytest.CaptureFixture[str]) -> None:
    evaluate.make_context("evaluate", ["bodies", "--clips", "A.bvh"])
    assert capsys.readouterr().err == ""


def test_former_names_are_not_in_the_help() -> None:
    assert "study" not in run("synth", "--help").stdout
    assert "bench" not in run("bulk", "--help").stdout
    assert "--service" not in run("bench", "--help").stdout
    for call in (("synth", "study"), ("bulk", "bench")):
        assert run(*call, "--help").exit_code == 0


@pytest.mark.parametrize(
    ("former", "present"),
    [
        (["synth", "study", "{folder}"], ["evaluate", "corpus", "{folder}"]),
        (["bulk", "bench", "--count", "3"], ["bench", "bulk", "--count", "3"]),
        (["bench", "--service", "--streams", "0"], ["bench", "service", "--streams", "0"]),
    ],
)
def test_moved_commands_do_the_same(former: list[str], present: list[str], tmp_path: Path) -> None:
    was, now = (run(*(word.format(folder=tmp_path) for word in call)) for call in (former, present))
    assert was.exit_code == now.exit_code != 0
    assert type(was.exception) is type(now.exception)
    assert was.stderr.startswith("note: ")
    assert " ".join(present[:2]) in was.stderr.splitlines()[0]
    assert str(was.exception) == str(now.exception)
