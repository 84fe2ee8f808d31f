"""What is installed, built and passed on: the locks, the wheel's bill of materials, licences of the page's packages."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from signsplice.service import page

ROOT = Path(__file__).resolve().parents[1]


def module(path: str) -> Any:
    """A program of the repository that is no part of a package."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


release = module("workshop/runs/release.py")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VIEWER_LOCK = json.loads((ROOT / "viewer/package-lock.json").read_text())["packages"]


def locked(name: str) -> dict[str, tuple[str, frozenset[str]]]:
    """Package -> version and hashes, of a lock."""
    entries = re.split(r"\n(?=\S)", re.sub(r"^#.*\n", "", (ROOT / "requirements" / name).read_text(), flags=re.M))
    pins: dict[str, tuple[str, frozenset[str]]] = {}
    for entry in entries:
        pin = re.match(r"([\w.-]+)==([^\s;]+)", entry)
        assert pin is not None, entry
        pins[canonicalize_name(pin[1])] = (pin[2], frozenset(re.findall(r"--hash=(sha256:[0-9a-f]{64})", entry)))
    return pins


def asked(texts: Iterable[str]) -> Iterator[Requirement]:
    """Requirements, with those of this package's own extras in their place."""
    for requirement in map(Requirement, texts):
        if requirement.name == PROJECT["name"]:
            for extra in sorted(requirement.extras):
                yield from asked(PROJECT["optional-dependencies"][extra])
        else:
            yield requirement


@pytest.mark.parametrize(("name", "extra"), [("dev.lock", "dev"), ("demo.lock", "video"), ("serve.lock", "serve")])
def test_a_lock_has_what_the_package_asks_for_with_hashes(name: str, extra: str) -> None:
    pins = locked(name)
    for requirement in asked([*PROJECT["dependencies"], *PROJECT["optional-dependencies"][extra], "hatchling"]):
        if requirement.name != "torch":
            version, _ = pins.get(canonicalize_name(requirement.name), ("", frozenset()))
            assert requirement.specifier.contains(version or "0"), f"{requirement}: {version or 'none'}; run make lock"
    assert all(hashes for _, hashes in pins.values())
    assert not [pin for pin in pins if re.match("torch$|triton|nvidia|cuda", pin)], "of one build of torch only"
    assert "://" not in (ROOT / "requirements" / name).read_text(), "an index's address"


def test_the_lowest_versions_of_every_extra_of_users_are_tried() -> None:
    extras = PROJECT["optional-dependencies"].keys() - {"dev", "fuzz"}
    assert {*module("workshop/runs/lowest_versions.py").EXTRAS} == extras


@pytest.mark.parametrize("folder", ["workshop", "research"])
def test_the_lock_of_development_has_what_the_other_distributions_ask_for(folder: str) -> None:
    pins, project = locked("dev.lock"), tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]
    for text in sum(project["optional-dependencies"].values(), project["dependencies"]):
        requirement = Requirement(text)
        if requirement.name == "torch":  # installed apart
            assert text in PROJECT["optional-dependencies"]["dev"]
        elif not requirement.name.startswith("signsplice"):
            assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)][0]), text


@pytest.mark.parametrize("name", ["demo.lock", "serve.lock"])
def test_users_have_the_versions_of_development(name: str) -> None:
    assert locked(name).items() <= locked("dev.lock").items()


def test_the_container_copies_what_is_there_and_runs_without_rights() -> None:
    """No test builds it: what can be read of it is checked."""
    lines = re.sub(r"\\\n *", "", (ROOT / "Dockerfile").read_text()).splitlines()
    sent = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    copied = [source for line in lines if re.match("COPY (?!--from)", line) for source in line.split()[1:-1]]
    assert set(copied) == sent
    assert all((ROOT / source).exists() for source in copied)
    assert {line.split()[1] for line in lines if line.startswith("FROM ")} == {"python:3.12-slim"}
    assert not re.search(r"https?://(?!127\.0\.0\.1)", "\n".join(lines)), "nothing is fetched but the locked packages"
    assert lines.index("USER signsplice") < next(n for n, line in enumerate(lines) if line.startswith("ENTRYPOINT"))
    assert any(line.startswith("HEALTHCHECK") and "/healthz" in line for line in lines)
    assert '"127.0.0.1:8000:8080"' in (ROOT / "compose.yaml").read_text()


def test_the_viewer_s_packages_have_hashes_and_run_nothing_when_installed() -> None:
    assert all(entry["integrity"].startswith("sha512-") for path, entry in VIEWER_LOCK.items() if path)
    assert "ignore-scripts=true" in (ROOT / "viewer/.npmrc").read_text().splitlines()


@pytest.fixture
def small_project(tmp_path: Path) -> Path:
    """A project with this package's metadata and next to no content."""
    folder = tmp_path / "project"
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "NOTICE", ".gitignore", *release.LOCKS):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    files = {
        "__init__.py": b"",
        "splicing/weights/cut.onnx": b"weights",
        "service/page/index.html": b"",
        "service/page/components.json": json.dumps([{"type": "library", "bom-ref": "x", "name": "x"}]).encode(),
    }
    for name, content in files.items():
        (folder / "src/signsplice" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "src/signsplice" / name).write_bytes(content)
    return folder


def released(project: Path, folder: Path) -> dict[str, bytes]:
    """What ``workshop/runs/release.py`` makes of a project: file name -> content."""
    program = [sys.executable, str(ROOT / "workshop/runs/release.py"), str(folder)]
    subprocess.run(program, cwd=project, check=True, timeout=120, capture_output=True)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.skipif(shutil.which("git") is None, reason="without git no commit can be named")
def test_two_builds_of_a_commit_have_the_same_bytes_and_say_what_they_were_made_of(
    small_project: Path, tmp_path: Path
) -> None:
    git = ["git", "-c", "user.name=x", "-c", "user.email=x@localhost"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "x"]):
        subprocess.run([*git, *words], cwd=small_project, check=True)
    first = released(small_project, tmp_path / "first")
    for path in small_project.rglob("*"):
        os.utime(path, (2e9, 2e9))
    assert released(small_project, tmp_path / "second") == first
    wheel, archive = (f"signsplice-{PROJECT['version']}{end}" for end in ("-py3-none-any.whl", ".tar.gz"))
    assert set(first) == {wheel, archive, "SHA256SUMS", "provenance.json"}
    check = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    assert subprocess.run(check, cwd=tmp_path / "first", capture_output=True).returncode == 0
    statement = json.loads(first["provenance.json"])
    digests = {made["name"]: made["digest"]["sha256"] for made in statement["subject"]}
    assert digests == {name: hashlib.sha256(first[name]).hexdigest() for name in (wheel, archive)}
    source, *locks = statement["predicate"]["buildDefinition"]["resolvedDependencies"]
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=small_project, capture_output=True, text=True)
    assert source == {"name": "source", "digest": {"gitCommit": head.stdout.strip()}}
    assert {lock["name"] for lock in locks} == set(release.LOCKS)
    (small_project / "README.md").write_text("changed")
    changed = released(small_project, tmp_path / "third")
    assert changed[wheel] != first[wheel]
    assert b"the working tree differs from the commit" in changed["provenance.json"]


def test_a_wheel_carries_its_bill_of_materials(small_project: Path, tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path / "dist")]
    subprocess.run(build, cwd=small_project, check=True, timeout=120)
    (wheel,) = (tmp_path / "dist").iterdir()
    with zipfile.ZipFile(wheel) as archive:
        (bill_name,) = (name for name in archive.namelist() if ".dist-info/sboms/" in name)
        bill = json.loads(archive.read(bill_name))
        assert any(name.endswith("licenses/NOTICE") for name in archive.namelist())
    parts: dict[str, dict[str, Any]] = {part["name"]: part for part in bill["components"]}
    assert (bill["bomFormat"], bill["metadata"]["component"]["version"]) == ("CycloneDX", PROJECT["version"])
    assert parts["cut.onnx"]["hashes"] == [{"alg": "SHA-256", "content": hashlib.sha256(b"weights").hexdigest()}]
    assert "x" in parts
    wanted = {requirement.name for requirement in asked(PROJECT["dependencies"])}
    assert {name for name, part in parts.items() if part.get("scope") == "required"} == wanted
    assert parts["uvicorn"]["versionRange"] == "vers:pypi/>=0.54"
    assert [name for name, part in parts.items() if name != "x" and not part.get("licenses")] == []
    installed = {part["name"]: part["licenses"][0]["expression"] for part in parts.values() if part.get("scope")}
    for name, licence in installed.items():
        with contextlib.suppress(metadata.PackageNotFoundError):
            stated = metadata.metadata(name)
            text = str([stated.get_all(field) for field in ("License-Expression", "License", "Classifier")])
            word = licence.removeprefix("LicenseRef-").split("-")[0]
            assert word.lower() in text.lower() or f"{name} {word}" == "matplotlib matplotlib", f"{name}: {text[:300]}"


def test_a_change_of_any_source_makes_the_page_anew(tmp_path: Path) -> None:
    """In the Makefile and in a wheel's build: sources in folders, one that came, and one that went."""
    hatch_build = module("hatch_build.py")
    shutil.copy(ROOT / "Makefile", tmp_path)
    built = tmp_path / hatch_build.PAGE / "index.html"
    sources = [tmp_path / "viewer" / name for name in ("build.mjs", "tsconfig.json", "src/main.ts", "src/page/part.ts")]
    others = [tmp_path / "viewer" / name for name in ("package-lock.json", "node_modules/.package-lock.json")]
    for path in (built, *sources, *others):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")

    def answers() -> tuple[bool, bool]:
        made = subprocess.run(["make", "--question", hatch_build.PAGE + "/index.html"], cwd=tmp_path)
        return made.returncode == 0, hatch_build.is_built(tmp_path)

    def set_all() -> None:
        for path in sorted(tmp_path.rglob("*")):
            os.utime(path, (1e9, 1e9))
        os.utime(built, (1.1e9, 1.1e9))

    set_all()
    assert answers() == (True, True)
    for source in sources:
        os.utime(source, (1.2e9, 1.2e9))
        assert answers() == (False, False), source
        set_all()
    (tmp_path / "viewer/src/page/new.ts").write_text("")
    assert answers() == (False, False)
    set_all()
    (tmp_path / "viewer/src/page/new.ts").unlink()
    assert answers() == (False, False)
    set_all()
    built.unlink()
    assert answers() == (False, False)


@pytest.mark.skipif(not page.BUILT.is_dir(), reason="the viewer is not built (make viewer)")
def test_what_the_page_carries_is_named_with_its_licence() -> None:
    components = json.loads((page.BUILT / "components.json").read_text())
    named = {part["name"]: part["version"] for part in components}
    assert named == {name: VIEWER_LOCK[f"node_modules/{name}"]["version"] for name in named}
    text = (page.BUILT / "index.html").read_text(encoding="utf-8")
    files = re.findall(r"^((?:@[\w.-]+/)?[\w.-]+)/\S+\.js:$", text, re.M)  # esbuild's headings over licence comments
    inner = re.findall(r"^ +\* (@[\w.-]+/[\w.-]+) v([\d.]+)$", text, re.M)  # of packages that came inside another
    assert {"three", "@pixiv/three-vrm"} <= set(files) <= set(named)
    assert dict(inner).items() <= named.items()
    notice = (ROOT / "NOTICE").read_text()
    for part in components:
        name, licence = part["name"], part["licenses"][0]["expression"]
        version = part["version"].rpartition(".")[0]
        assert re.search(rf"^  {re.escape(name)} +{re.escape(version)} +{licence} ", notice, re.M), f"NOTICE: {part}"
        if name != "swagger-ui-dist":
            assert f"{name} {part['version']}, {licence}" in text, "the licence travels with the page"
    in_docs = {path.name for path in (page.BUILT / "docs").iterdir()}
    assert {"LICENSE", "NOTICE", "swagger-ui-bundle.js.LICENSE.txt"} <= in_docs
