"""Builds the viewer into the package's wheel, if Node is installed, and writes the wheel's bill of materials."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PAGE = "src/signsplice/service/page"
NETWORKS = "src/signsplice/splicing/weights"
BILL = "signsplice.cdx.json"
TOOLS = ("dev", "fuzz")
"""Extras of those who work on the package; no user asks for what is in them."""
LICENCES = {
    "Apache-2.0": ("dracopy", "prometheus-client", "pyarrow", "python-multipart", "ray"),
    "BSD-3-Clause": ("click", "numpy", "protobuf", "scipy", "uvicorn", "websockets"),
    "MIT": ("fastapi", "meshopt", "moderngl", "onnxruntime", "pygltflib", "rapidfuzz", "rich", "simplemma"),
    "MIT-CMU": ("pillow",),
}
"""Licence -> packages that a wheel asks for, as docs/dependencies.md has them."""


class ViewerHook(BuildHookInterface):  # type: ignore[misc]
    """Puts the page that ``make viewer`` builds into the wheel, and a CycloneDX bill of materials (PEP 770); without
    Node the wheel has no viewer.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page, unless it is newer than its sources or the install is editable; then write the bill."""
        if version == "editable":
            return
        self._build_page()
        bill = Path(self.directory) / BILL
        bill.parent.mkdir(parents=True, exist_ok=True)
        bill.write_text(json.dumps(self._bill(), indent=1) + "\n", encoding="utf-8")
        build_data["sbom_files"].append(str(bill))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the bill beside the wheel, which holds it now."""
        (Path(self.directory) / BILL).unlink(missing_ok=True)

    def _build_page(self) -> None:
        root = Path(self.root)
        if is_built(root):
            return
        npm = shutil.which("npm")
        try:
            for command in (["ci", "--no-audit", "--no-fund", "--silent"], ["run", "--silent", "build"]):
                subprocess.run([npm or "npm", *command], cwd=root / "viewer", check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"the viewer was not built, so this wheel has none, or an older one: {error}", file=sys.stderr)

    def _bill(self) -> dict[str, Any]:
        """CycloneDX 1.7, without time and serial number, so that equal sources make equal wheels.

        What the wheel carries has hashes; what it only asks for is external and has a range of versions.
        """
        core, root = self.metadata.core, Path(self.root)
        licence = [{"expression": core.license_expression}]
        networks = [
            {
                "type": "machine-learning-model",
                "bom-ref": f"networks/{path.relative_to(root / NETWORKS)}",
                "name": str(path.relative_to(root / NETWORKS)),
                "licenses": licence,
                "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}],
            }
            for path in sorted((root / NETWORKS).rglob("*.onnx"))
        ]
        listed = root / PAGE / "components.json"
        page = json.loads(listed.read_text(encoding="utf-8")) if listed.is_file() else []
        required = [_external(text, "required") for text in core.dependencies]
        extras = {text for extra, texts in core.optional_dependencies.items() if extra not in TOOLS for text in texts}
        optional = [_external(text, "optional") for text in sorted(extras) if not text.startswith(f"{core.name}[")]
        purl = f"pkg:pypi/{core.name}@{self.metadata.version}"
        unversioned = [part["bom-ref"] for part in page if "components" in part]
        return {
            "bomFormat": "CycloneDX",
            "specVersion": "1.7",
            "version": 1,
            "metadata": {
                "lifecycles": [{"phase": "build"}],
                "component": {
                    "type": "library",
                    "bom-ref": purl,
                    "name": core.name,
                    "version": self.metadata.version,
                    "purl": purl,
                    "licenses": licence,
                },
            },
            "components": [*networks, *page, *required, *optional],
            "dependencies": [{"ref": purl, "dependsOn": [part["bom-ref"] for part in (*networks, *page, *required)]}],
            "compositions": [{"aggregate": "incomplete", "assemblies": unversioned}] if unversioned else [],
        }


def is_built(root: Path) -> bool:
    """Whether the page is newer than every file and folder that it is built from; a folder is as old as its last file
    that came or went.
    """
    page = root / PAGE / "index.html"
    sources = [*(root / "viewer").glob("*.*"), root / "viewer/src", *(root / "viewer/src").rglob("*")]
    newest = max((source.stat().st_mtime for source in sources if source.exists()), default=0.0)
    return page.is_file() and page.stat().st_mtime > newest


def _external(requirement: str, scope: str) -> dict[str, Any]:
    """The component of a requirement like ``uvicorn[standard]>=0.30``, which the wheel asks for and does not hold."""
    name, _, versions = re.fullmatch(r"([\w.-]+)(\[[^]]*\])?(.*)", requirement).groups()  # type: ignore[union-attr]
    purl = f"pkg:pypi/{name}"
    return {
        "type": "library",
        "bom-ref": f"{purl} {scope}",
        "name": name,
        "purl": purl,
        "scope": scope,
        "licenses": [{"expression": next(key for key, names in LICENCES.items() if name.lower() in names)}],
        "isExternal": True,
        "versionRange": f"vers:pypi/{versions.replace(',', '|').replace('==', '')}",
    }
