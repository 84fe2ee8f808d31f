"""Measures the size and the coupling of a source tree: files, code lines, command options, and the path of one splice.

    PYTHONPATH=src python workshop/runs/structure.py [ROOT ...]

Prints one column for each root of a checkout (default: this one); the tree's own sources run in their own process with
the interpreter that runs this script. A change of file: of two successive calls of the package's functions, the second
is in another file. They are counted while ``splice`` joins two words that ship, without imports and the opening of the
networks.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import FrameType

CLASSICAL = "cutter='pose-velocity', transition='hermite', duration='tempo'"
SPLICES = {"default": "", "classical": CLASSICAL}


def count_code_lines(source: str) -> int:
    """Returns the number of lines of code without blank lines, comments and docstrings."""
    tree = ast.parse(source)
    lines = {number for number, line in enumerate(source.splitlines(), 1) if line.strip()}
    lines -= {number for number, line in enumerate(source.splitlines(), 1) if line.lstrip().startswith("#")}
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def count_click_decorators(tree: ast.AST) -> int:
    """Returns the number of decorators that come from click: options, arguments, commands and groups."""
    n_decorators = 0
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            names = [
                ast.unparse(decorator.func if isinstance(decorator, ast.Call) else decorator)
                for decorator in node.decorator_list
            ]
            words = ("option", "argument", "command", "group", "version_option", "pass_context")
            n_decorators += sum(name.rpartition(".")[2] in words for name in names)
    return n_decorators


def list_foreign_writes(tree: ast.AST) -> list[str]:
    """Returns the assignments to an attribute of anything but ``self`` and ``cls``."""
    writes = []
    for node in ast.walk(tree):
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, (ast.AugAssign, ast.AnnAssign)):
            targets = [node.target]
        for target in targets:
            for part in ast.walk(target):
                if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store):
                    text = ast.unparse(part)
                    if text.split(".")[0] not in ("self", "cls"):
                        writes.append(text)
    return writes


def measure_functions(tree: ast.AST) -> list[int]:
    """Returns the lines from the first to the last of every function, docstring included."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [(node.end_lineno or node.lineno) - node.lineno + 1 for node in ast.walk(tree) if isinstance(node, kinds)]


def measure_tree(source: Path) -> dict[str, object]:
    """Returns the size of the package below ``source`` (the folder signsplice)."""
    files = sorted(source.rglob("*.py"))
    trees = {path: ast.parse(path.read_text()) for path in files}
    splicing = [path for path in files if "splicing" in path.relative_to(source).parts[:-1]]
    sizes = {path: count_code_lines(path.read_text()) for path in files}
    lengths = sorted(length for tree in trees.values() for length in measure_functions(tree))
    sentence = next((path for path in files if path.match("splicing/sentence.py")), None)
    return {
        "files": len(files),
        "code lines": sum(sizes.values()),
        "click decorators": sum(map(count_click_decorators, trees.values())),
        "writes to other objects": sum(len(list_foreign_writes(tree)) for tree in trees.values()),
        "median function, lines": lengths[len(lengths) // 2],
        "longest function, lines": lengths[-1],
        "splicing: files": len(splicing),
        "splicing: code lines": sum(sizes[path] for path in splicing),
        "splicing: writes to other objects": sum(len(list_foreign_writes(trees[path])) for path in splicing),
        "splicing: longest file, lines": max(len(path.read_text().splitlines()) for path in splicing),
        "splicing: longest function, lines": max(max(measure_functions(trees[path]), default=0) for path in splicing),
        "sentence.py: code lines": sizes[sentence] if sentence else 0,
    }


def count_visits(options: str) -> tuple[Counter[str], Counter[tuple[str, str]], set[str]]:
    """Returns the calls into each file of the package, the changes from file to file, and the public classes of
    splicing whose methods run or of which objects are made, while two words are joined.
    """
    import signsplice as ss
    from signsplice.lexicon import open_shipped_lexicon

    folder = str(Path(ss.__file__).parent) + os.sep
    with open_shipped_lexicon() as lexicon:
        warm_up_words = [lexicon.clip("MOTHER"), lexicon.clip("HOUSE")]
        words = [lexicon.clip("I"), lexicon.clip("SIGN")]
    chosen_options = eval(f"ss.SpliceOptions({options})")
    ss.splice(warm_up_words, chosen_options)
    calls: Counter[str] = Counter()
    changes: Counter[tuple[str, str]] = Counter()
    types: set[str] = set()
    last = ""

    def watch(frame: FrameType, event: str, _: object) -> None:
        nonlocal last
        name = frame.f_code.co_filename
        if event == "call" and "self" in frame.f_code.co_varnames[:1]:
            kinds = type(frame.f_locals.get("self")).__mro__
            types.update(kind.__name__ for kind in kinds if kind.__module__.startswith("signsplice.splicing"))
        if event == "call" and name.startswith(folder):
            name = name.removeprefix(folder)
            calls[name] += 1
            if last not in ("", name):
                changes[last, name] += 1
            last = name

    sys.setprofile(watch)
    try:
        ss.splice(words, chosen_options)
    finally:
        sys.setprofile(None)
    return calls, changes, {name for name in types if not name.startswith("_")}


def measure_splices() -> dict[str, object]:
    """Returns files and changes of file of a splice of two words, by kind of methods."""
    columns: dict[str, object] = {}
    for name, options in SPLICES.items():
        calls, changes, types = count_visits(options)
        columns[f"splice, {name}: files"] = len(calls)
        columns[f"splice, {name}: changes of file"] = sum(changes.values())
        columns[f"splice, {name}: types of splicing"] = len(types)
        if os.environ.get("DETAIL"):
            print(name, *calls.most_common(), *sorted(types), sep="\n  ", file=sys.stderr)
            print(*changes.most_common(60), sep="\n  ", file=sys.stderr)
    return columns


def measure_checkout(root: Path) -> dict[str, object]:
    """Returns the whole column of one checkout."""
    env = {**os.environ, "PYTHONPATH": str(root / "src"), "OMP_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, __file__, "--splices"], env=env, stdout=subprocess.PIPE, text=True, check=True
    )
    return {**measure_tree(root / "src" / "signsplice"), **json.loads(run.stdout)}


def main() -> None:
    """Prints the table."""
    if sys.argv[1:] == ["--splices"]:
        print(json.dumps(measure_splices()))
        return
    roots = [Path(name).resolve() for name in sys.argv[1:]] or [Path(__file__).resolve().parents[2]]
    columns = [measure_checkout(root) for root in roots]
    print("| what | " + " | ".join(str(root) for root in roots) + " |")
    print("| --- |" + " --- |" * len(roots))
    for what in columns[0]:
        print(f"| {what} | " + " | ".join(str(column[what]) for column in columns) + " |")


if __name__ == "__main__":
    main()
