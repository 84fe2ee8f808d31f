"""Avatars in FBX files as ``.glb``: joints and meshes at rest, blend shapes, colours, and textures in PNG or JPEG.

The rest pose is the one in which skins are bound. Scales go into vertices and lengths of bones.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pygltflib import Image, Material, PbrMetallicRoughness, Texture, TextureInfo

from signsplice.errors import FormatError
from signsplice.formats.fbx_mesh import FbxMeshes
from signsplice.formats.fbx_objects import Id, name_of, numbers_of
from signsplice.formats.fbx_scene import BONES, FbxScene, Transforms, nearest_rotation
from signsplice.formats.fbx_takes import Take
from signsplice.formats.gltf_skeleton import unique
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.limits import DEFAULT_LIMITS, ReadLimits
from signsplice.formats.reading import read_bytes
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray

_KINDS = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""How a picture begins that glTF holds."""
_COLOURS = ("diffuse", "basecolor", "base_color")
"""Parts of the names of properties that are a material's colour."""


def as_glb(content: bytes, file: str, folder: Path | None, limits: ReadLimits = DEFAULT_LIMITS) -> bytes:
    """The bytes of a .glb with the avatar in an FBX file; ``folder``: where textures that are files are looked for,
    nowhere with None.

    Raises ``FormatError`` where it has no bones or is of version 6, and what its content causes.
    """
    scene = FbxScene(content, file, limits)
    if scene.objects.has_old_takes:
        what = "is of version 6, whose meshes are not read; FBX2glTF (npm: fbx2gltf, free) makes a .glb of it"
        raise FormatError(what, file=file)
    order = [key for key in scene.order if scene.models[key].kind in BONES or key in scene.skinned]
    if not order:
        raise FormatError("is no avatar: it holds no bones", file=file)
    return _AvatarDocument(scene, order, folder, limits).content()


class _AvatarDocument:
    """A glTF document of a scene under construction; ``order``: its joints, parents first."""

    def __init__(self, scene: FbxScene, order: list[Id], folder: Path | None, limits: ReadLimits) -> None:
        self.scene, self.order, self.folder, self.limits = scene, order, folder, limits
        self.rows = {key: row for row, key in enumerate(order)}
        self.writer = DocumentWriter()
        self._materials: dict[Id | None, int] = {}

    def content(self) -> bytes:
        """Its bytes."""
        writer, worlds = self.writer, _rest_worlds(self.scene, self.rows)
        for name in unique([self.scene.models[key].name for key in self.order]):
            writer.node(name)
        writer.scene(0)
        writer.skin(range(len(self.order)), self._place(worlds), 0)
        writer.gltf.skins[0].skeleton = None
        for parts in FbxMeshes(self.scene, worlds, self.rows).all():
            names = list(parts[0][1].morphs)
            primitives = [writer.primitive([part], 1.0, names, self._material(key)) for key, part in parts]
            writer.add_mesh(parts[0][1].name, primitives, names)
        document = writer.finish("", 1.0)
        document.animations = []
        return b"".join(document.save_to_bytes())

    def _place(self, worlds: dict[Id, FloatArray]) -> FloatArray:
        """Put the joints where they are at rest; returns the matrices (J, 4, 4) from the world to each."""
        matrices = np.stack([worlds[key] for key in self.order])
        found = [nearest_rotation(matrix[:3, :3]) for matrix in matrices]
        quats = np.array([rotation.IDENTITY if quat is None else quat for quat in found])
        self.scene.to_axes(quats)
        at = self.scene.metres * matrices[:, :3, 3] @ self.scene.axes.T
        nodes, parents = self.writer.gltf.nodes, self.scene.parent_rows(self.order)
        for row, above in enumerate(parents):
            below = rotation.inverse(quats[above] if above >= 0 else rotation.IDENTITY)
            nodes[row].translation = rotation.rotate(below, at[row] - (at[above] if above >= 0 else 0.0)).tolist()
            nodes[row].rotation = rotation.normalize(rotation.multiply(below, quats[row])).tolist()
            if above >= 0:
                nodes[above].children.append(row)
        self.writer.gltf.scenes[0].nodes = np.flatnonzero(parents < 0).tolist()
        inverse = np.tile(np.eye(4), (len(at), 1, 1))
        inverse[:, :3, :3] = rotation.to_matrix(rotation.inverse(quats))
        inverse[:, :3, 3] = -np.einsum("jab,jb->ja", inverse[:, :3, :3], at)
        return inverse

    def _material(self, key: Id | None) -> int:
        """The number of a material."""
        if key not in self._materials:
            record = None if key is None else self.scene.objects.records[key]
            numbers = {} if record is None else numbers_of(record)
            colour = numbers.get("DiffuseColor", numbers.get("Diffuse", np.ones(3)))[:3]
            surface = PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=0.8)
            surface.baseColorFactor = [*np.clip(colour, 0.0, 1.0).tolist(), 1.0]
            material = Material(pbrMetallicRoughness=surface, doubleSided=True)
            if record is not None and key is not None:
                material.name = name_of(record.values[1])
                self._add_texture(key, material, surface)
            self.writer.gltf.materials.append(material)
            self._materials[key] = len(self.writer.gltf.materials) - 1
        return self._materials[key]

    def _add_texture(self, key: Id, material: Material, surface: PbrMetallicRoughness) -> None:
        """Give a material its picture, where it has one that glTF holds."""
        textures = [*self.scene.objects.on(key, "Texture")]
        for texture, what in textures:
            picture = self._picture(texture) if any(part in what.lower() for part in _COLOURS) else b""
            kind = next((kind for begin, kind in _KINDS.items() if picture.startswith(begin)), "")
            if kind:
                gltf = self.writer.gltf
                view = self.writer.view(np.frombuffer(picture, np.uint8))
                gltf.images.append(Image(bufferView=view, mimeType=kind))
                gltf.textures.append(Texture(source=len(gltf.images) - 1))
                surface.baseColorTexture = TextureInfo(index=len(gltf.textures) - 1)
                surface.baseColorFactor = [1.0] * 4
                if any("transparen" in other.lower() for _, other in textures):
                    material.alphaMode, material.alphaCutoff = "MASK", 0.5
                return

    def _picture(self, texture: Id) -> bytes:
        """The bytes of a texture's picture: in the file, or a file in its folder; empty where it is not found."""
        records = [self.scene.objects.records[texture]]
        records += [self.scene.objects.records[video] for video, _ in self.scene.objects.on(texture, "Video")]
        for record in reversed(records):
            content: Any = next(iter(found.values if (found := record.find("Content")) else ()), b"")
            if isinstance(content, bytes) and content:
                return content
        names = [str(found.values[0]) for record in records for name in ("RelativeFilename", "FileName")
                 if (found := record.find(name)) is not None and found.values]  # fmt: skip
        for name in names:
            if self.folder is None:
                continue
            path = (self.folder / name.replace("\\", "/").rpartition("/")[2]).resolve()
            if path.is_relative_to(self.folder.resolve()) and path.is_file():
                return read_bytes(path, self.limits.file_bytes)
        return b""


def _rest_worlds(scene: FbxScene, joints: dict[Id, int]) -> dict[Id, FloatArray]:
    """Model -> its matrix (4, 4) in the world at rest: joints as their skins are bound, and all else upon them."""
    still, found, rest = Take("", (0.0, 0.0), ()), dict[Id, Transforms](), dict[Id, FloatArray]()
    turned, worlds = dict[Id, FloatArray](), dict[Id, FloatArray]()  # as the file has them
    for key in scene.order:
        above = scene.parents.get(key)
        own = found[key] = scene.transforms(key, still, np.zeros(1), None if above is None else found[above])
        turned[key], worlds[key] = rotation.to_matrix(own.quats[0]), np.eye(4)
        worlds[key][:3, 3] = own.positions[0]
        if above is not None:
            worlds[key][:3, 3] = worlds[above][:3, 3] + turned[above] @ own.positions[0]
            turned[key] = turned[above] @ turned[key]
        worlds[key][:3, :3] = turned[key] @ own.scaling[0]
        bound = scene.binds.get(key) if key in joints and key in scene.bound else None
        carried = worlds[key] if above is None else rest[above] @ np.linalg.inv(worlds[above]) @ worlds[key]
        rest[key] = carried if bound is None else bound
    return rest
