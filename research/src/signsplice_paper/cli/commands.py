"""All commands of `signsplice-paper` in one group."""

from __future__ import annotations

import click

from signsplice_paper.cli import evaluation, pages, pairs, training


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="signsplice-paper")
def app() -> None:
    """Reproduce the LpTransformer paper: train its systems, judge them, write its tables and figures."""


for _module in (evaluation, training, pages, pairs):
    for _command in _module.COMMANDS:
        app.add_command(_command)
