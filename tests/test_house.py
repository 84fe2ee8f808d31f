"""The structure of all three packages: which room may import which, unique class names, one cache, light imports."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import signsplice

ROOT = Path(__file__).resolve().parents[1]
SOURCES = (ROOT / "src", ROOT / "workshop" / "src", ROOT / "research" / "src")

FLOORS = {
    "errors": 0,
    "hooks": 0,
    "children": 0,
    "progress": 0,
    "motion": 1,
    "rig": 2,
    "body": 3,
    "formats": 4,
    "render": 5,
    "signer": 6,
    "written": 7,
    "lexicon": 8,
    "splicing": 9,
    "service": 10,
    "bulk": 10,
    "bench": 11,
    "workshop corpora": 13,
    "workshop measure": 14,
    "workshop train": 15,
    "workshop cli": 16,
    "paper": 17,
    "paper train": 18,
    "paper cli": 19,
    "paper __main__": 20,
}
"""Imports run down only. What is not named here (the command line, the demo) lies on top of the product."""

SPLICING = (
    "contracts", "durations", "runtime", "bundle", "features", "cutters", "curves", "learned", "word",
    "seam", "collisions", "person", "carriage", "passes", "tempo", "letters", "pauses", "result", "faces", "landmarks",
    "mouthing",
    "systems", "from_positions", "lptransformer", "options", "cards", "stages", "sentence", "report", "engine",
    "stitch", "bulk_splice",
)  # fmt: skip
"""Files of splicing in the order in which they can be read: each imports only from those before it."""

TOP = 12
OTHERS = ("signsplice_workshop", "signsplice_paper")
PACKAGES = {"signsplice", *OTHERS}
MODULES = sorted(path for source in SOURCES for path in source.rglob("*.py"))


def room(module: str) -> str:
    """signsplice.motion.clip -> motion; signsplice_paper.train.tasks -> paper train; signsplice_paper.plan -> paper."""
    package, *parts = module.split(".")
    if package not in OTHERS:
        return parts[0] if parts else ""
    short = package.removeprefix("signsplice_")
    return f"{short} {parts[0]}" if parts and f"{short} {parts[0]}" in FLOORS else short


def module_name(path: Path) -> str:
    (source,) = (source for source in SOURCES if path.is_relative_to(source))
    parts = path.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_name(path) for path in MODULES}


def imports(path: Path, inside_functions: bool = True, type_checking: bool = False) -> set[str]:
    """Modules that a file imports; those of TYPE_CHECKING blocks only if ``type_checking``."""
    found: set[str] = set()

    def walk(node: ast.AST) -> None:
        hidden = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        if hidden and not type_checking:
            return
        if not inside_functions and isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            base = node.module or ""
            known = {alias.name for alias in node.names if f"{base}.{alias.name}" in NAMES}
            found.update(f"{base}.{name}" for name in known)
            if len(known) < len(node.names):
                found.add(base)
        for child in ast.iter_child_nodes(node):
            walk(child)

    walk(ast.parse(path.read_text()))
    return found


def floor(module: str) -> int:
    return FLOORS.get(room(module), TOP)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: module_name(path))
def test_imports_run_down(path: Path) -> None:
    own = module_name(path)
    if own == "signsplice":
        return
    for target in imports(path) | modules_in_strings(path):
        if target.split(".")[0] in PACKAGES:
            same = room(target) == room(own) or (floor(own) == TOP and room(own) in ("cli", "__main__"))
            assert floor(target) < floor(own) or (same and floor(target) == floor(own)), f"{own} names {target}"


def modules_in_strings(path: Path) -> set[str]:
    """Modules of all packages that a file's strings name, docstrings apart; an import could follow from each."""
    tree = ast.parse(path.read_text())
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone
    ]
    words = {word for text in texts for word in re.findall(r"[A-Za-z_]\w*(?:\.\w+)+|signsplice_\w+", text)}
    return {name for word in words for name in (word, *(f"{package}.{word}" for package in PACKAGES)) if name in NAMES}


def test_strings_that_name_modules_are_found(tmp_path: Path) -> None:
    file = tmp_path / "a.py"
    file.write_text('"""signsplice.cli"""\nimport_module("signsplice.render.notebook")\nx = f"{y} splicing.engine"\n')
    assert modules_in_strings(file) == {"signsplice.render.notebook", "signsplice.splicing.engine"}


@pytest.mark.parametrize(
    "path",
    [path for path in MODULES if path.is_relative_to(SOURCES[0] / "signsplice" / "splicing")],
    ids=lambda path: path.stem,
)
def test_imports_within_splicing_run_down(path: Path) -> None:
    own = module_name(path).removeprefix("signsplice.splicing").lstrip(".")
    for target in imports(path):
        if target.startswith("signsplice.splicing."):
            assert SPLICING.index(target.split(".")[2]) < SPLICING.index(own), f"{own} imports {target}"


def test_splicing_writes_to_no_other_objects_attributes() -> None:
    """But to onnxruntime's options, which can only be set by writing to them."""
    found = set()
    for path in MODULES:
        if path.is_relative_to(SOURCES[0] / "signsplice" / "splicing"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                    found.add((path.stem, ast.unparse(node.value)))
    assert {row for row in found if row[1] != "self"} == {("bundle", "options")}


def test_no_import_runs_in_a_circle() -> None:
    """Nor behind TYPE_CHECKING; a package's lazy names, which it imports when they are asked for, do not count."""
    graph = {module_name(path): imports(path, False, path.name != "__init__.py") & NAMES for path in MODULES}
    done: set[str] = set()

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " -> ".join((*path, module))
        if module not in done:
            for target in graph.get(module, ()):
                visit(target, (*path, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def test_no_file_is_longer_than_600_lines() -> None:
    assert [str(path) for path in MODULES if len(path.read_text().splitlines()) > 600] == []


def test_motion_rig_and_body_know_no_file() -> None:
    allowed = {"numpy", "scipy", "signsplice"} | set(sys.stdlib_module_names) - {"io", "json", "os", "pathlib"}
    for path in MODULES:
        if room(module_name(path)) in ("motion", "rig", "body"):
            assert {target.split(".")[0] for target in imports(path)} <= allowed, path


def test_a_class_name_occurs_once() -> None:
    homes: dict[str, list[str]] = {}
    for path in MODULES:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name.lstrip("_"), []).append(module_name(path))
    assert {name: where for name, where in homes.items() if len(where) > 1} == {}


def test_the_package_keeps_state_in_one_place() -> None:
    """``motion.cache.CACHE`` is the only cache of a module; instances may keep their own."""
    found = []
    for path in MODULES:
        for node in ast.parse(path.read_text()).body:
            text = ast.unparse(node)
            if isinstance(node, (ast.Assign, ast.AnnAssign)) and re.search(r"Weak\w*Dictionary\(|\bCache\(", text):
                found.append(f"{module_name(path)}: {text}")
            for part in ast.walk(node):
                if isinstance(part, (ast.FunctionDef, ast.ClassDef)):
                    decorators = [ast.unparse(decorator) for decorator in part.decorator_list]
                    cached = [text for text in decorators if re.match(r"(functools\.)?(lru_)?cache\b", text)]
                    found += [f"{module_name(path)}: {part.name}" for _ in cached]
    assert found == ["signsplice.motion.cache: CACHE = Cache()"]


def dependencies(folder: str, extra: str = "") -> set[str]:
    """Names of the packages that a distribution, or an extra of it, asks for."""
    project = tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]
    entries = project["optional-dependencies"][extra] if extra else project["dependencies"]
    return {re.split(r"[\[>=]", entry)[0] for entry in entries}


def test_rooms_need_only_declared_dependencies() -> None:
    names = dependencies(".")
    assert names == {"numpy", "scipy", "onnxruntime", "protobuf", "click", "rich", "pygltflib", "rapidfuzz"}
    assert dependencies("workshop") == {"signsplice"}
    assert dependencies("research") == {"signsplice", "signsplice-workshop", "matplotlib", "pillow"}
    names |= {"google"}  # protobuf's module
    optional = {
        "PIL",
        "imageio_ffmpeg",
        "matplotlib",
        "pybvh",
        "simplemma",
    }  # imported inside functions, for those who have them
    training = dependencies("workshop", "train")
    serving = {"fastapi", "starlette", "uvicorn", "pydantic", "prometheus_client", "python_multipart"}
    loading = {"httpx", "psutil", "websockets"}  # what calls the service to measure it
    more = {
        "signsplice.bench.service": loading,
        "signsplice.bench.bulk": {"pyarrow"},
        "signsplice.cli.bulk": {"pyarrow"},
        "signsplice.cli.service": serving,
        "signsplice_workshop.cli.train": training,
        "signsplice_paper.cli.training": training,
        "signsplice_paper.report": dependencies("research", "report"),
    }
    for path in MODULES:
        module = module_name(path)
        if room(module) in ("service", "bulk", "workshop train", "paper train"):
            continue
        outside = {t.split(".")[0] for t in imports(path)} - set(sys.stdlib_module_names) - PACKAGES
        assert outside <= names | optional | more.get(module, set()), path
        at_top = {t.split(".")[0] for t in imports(path, inside_functions=False)}
        assert not at_top & (optional | training | serving | loading), path


def test_only_the_service_imports_web_libraries() -> None:
    allowed = {"numpy", "fastapi", "starlette", "uvicorn", "websockets", "pydantic", "prometheus_client", "signsplice"}
    for path in MODULES:
        if room(module_name(path)) == "service":
            assert {t.split(".")[0] for t in imports(path)} <= allowed | set(sys.stdlib_module_names), path
        elif path.name != "service.py" and room(module_name(path)) != "":
            assert not any(t.startswith("signsplice.service") for t in imports(path)), path


def test_only_bulk_imports_parquet_and_ray() -> None:
    allowed = {"numpy", "pyarrow", "ray", "signsplice"} | set(sys.stdlib_module_names)
    for path in MODULES:
        if room(module_name(path)) == "bulk":
            assert {t.split(".")[0] for t in imports(path)} <= allowed, path
            assert "ray" not in {t.split(".")[0] for t in imports(path, inside_functions=False)}, path
        elif path.name != "bulk.py":
            assert not any(t.startswith("signsplice.bulk") for t in imports(path)), path


def test_only_training_imports_torch() -> None:
    allowed = {"numpy", "torch", "filelock", "onnx", "onnxruntime", "onnxscript", *PACKAGES}
    for path in MODULES:
        if room(module_name(path)) in ("workshop train", "paper train"):
            assert {t.split(".")[0] for t in imports(path)} <= allowed | set(sys.stdlib_module_names), path
        else:
            at_top = imports(path, inside_functions=False)
            assert not {t for t in at_top & NAMES if room(t) in ("workshop train", "paper train")}, path


def test_one_module_imports_onnxruntime() -> None:
    """It switches the library's telemetry off before the import, which is too late afterwards."""
    others = [
        path
        for folder in ("src", "research", "workshop/src", "workshop/attacks")
        for path in (ROOT / folder).rglob("*.py")
    ]
    importing = {path.name for path in others if "onnxruntime" in {t.split(".")[0] for t in imports(path)}}
    assert importing == {"runtime.py"}


def in_a_fresh_process(code: str) -> str:
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout


def test_a_splice_imports_no_torch_and_no_plotting() -> None:
    heavy = in_a_fresh_process(
        "import sys, signsplice as ss\n"
        "from signsplice.lexicon import open_shipped_lexicon\n"
        "words = open_shipped_lexicon()\n"
        "ss.splice([words.clip('I'), words.clip('SIGN')])\n"
        "heavy = {'torch', 'matplotlib', 'PIL', 'onnx', 'click', 'rich', 'pandas', 'scipy.signal', 'scipy.stats'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    assert heavy.strip() == "[]"


def test_the_engine_loads_no_database_and_a_lexicon_no_signer() -> None:
    code = "import sys, signsplice.splicing.engine; print({'sqlite3', 'rapidfuzz'} & set(sys.modules))"
    assert in_a_fresh_process(code).strip() == "set()"
    code = (
        "import sys, signsplice as ss\n"
        "words = ss.open_lexicon()\n"
        "words.clip('I'), 'NOTHING' in words\n"
        "print(sorted(name for name in sys.modules if name.startswith(('signsplice.signer', 'signsplice.written'))))"
    )
    assert in_a_fresh_process(code).strip() == "[]"


def test_a_classical_splice_opens_no_network() -> None:
    heavy = in_a_fresh_process(
        "import sys, signsplice as ss\n"
        "from signsplice.lexicon import open_shipped_lexicon\n"
        "words = open_shipped_lexicon()\n"
        "options = ss.SpliceOptions('pose-velocity', 'hermite', 'tempo')\n"
        "ss.splice([words.clip('I'), words.clip('SIGN')], options)\n"
        "print('onnxruntime' in sys.modules)"
    )
    assert heavy.strip() == "False"


def test_a_clip_becomes_another_format_without_scipy() -> None:
    """Its import takes longer than the conversion."""
    heavy = in_a_fresh_process(
        "import sys\n"
        "from signsplice.formats import encode\n"
        "from signsplice.lexicon import open_shipped_lexicon\n"
        "clip = open_shipped_lexicon().clip('I')\n"
        "_ = encode(clip, 'a.glb'), encode(clip, 'a.bvh'), encode(clip, 'a.vrma')\n"
        "print('scipy' in sys.modules)"
    )
    assert heavy.strip() == "False"


def test_import_and_help_are_light() -> None:
    code = "import sys, signsplice, signsplice.cli.commands; print({'numpy', 'rich', 'scipy'} & set(sys.modules))"
    assert in_a_fresh_process(code).strip() == "set()"


def test_the_public_names_are_few_and_documented() -> None:
    first = (
        "Clip FormatError InputError Lexicon Piece RigMismatchError SignspliceError Skeleton SpliceOptions "
        "SpliceResult inbetween load open_lexicon read_avatar retarget save sign splice stitch stream"
    )
    more = (
        "Cut Cutter CurveProblem CurveTransition Stream Transition Word concatenate parse words_of write_pictures "
        "write_report"
    )
    assert sorted(signsplice.__all__) == sorted([*first.split(), *more.split()])
    for name in signsplice.__all__:
        value = getattr(signsplice, name)
        assert value.__doc__, name
        assert value.__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        signsplice.nothing  # noqa: B018
    assert callable(signsplice.splice), "the function, also after its package was imported"
    code = "import signsplice.splicing.engine, signsplice; print(signsplice.splice.__name__)"
    assert in_a_fresh_process(code).strip() == "splice"


def test_examples_import_the_public_face_alone() -> None:
    for path in sorted((ROOT / "examples").glob("*.py")):
        ours = {target for target in imports(path) if target.startswith("signsplice")}
        assert ours == {"signsplice"}, path


def test_every_public_function_has_a_docstring() -> None:
    for path in MODULES:
        nodes = list(ast.parse(path.read_text()).body)
        for node in nodes:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{path.name}:{node.lineno} {node.name}"
                if isinstance(node, ast.ClassDef):
                    nodes += node.body
