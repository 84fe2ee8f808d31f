"""Drawing with OpenGL on EGL: a graphics card, or Mesa's llvmpipe, which needs none and no display.

Joints carry the vertices once. Then depth is drawn as the key light sees it, then the figure at several samples a
pixel, and a last pass averages the samples, adds the shadow, and draws outlines as ``raster.Canvas.finish`` does.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from threading import local
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.render.raster import AMBIENT, BACKGROUND, DEPTH_TONE, KEY, OUTLINE_STEP, RIM, Camera, Pixels

if TYPE_CHECKING:
    from signsplice.render.skin import Skin, Surface

LACK = (
    "pictures are drawn without OpenGL: pip install 'signsplice[video]' and Mesa's EGL (apt install libegl1 "
    "libgl1-mesa-dri) draw films several times as fast, with shadows"
)
"""What to tell users of machines without EGL."""
_FINE, _COARSE, _SMALL_PX = 2.0, 1.5, 800 * 800
"""Samples a pixel to each side in pictures of up to so many pixels, and in larger ones."""
_SHADOW_PX = 768
"""Width and height of the shadow map."""
_BIAS = 0.004
"""Depth by which a surface has to lie behind another to be in its shadow, diameters of the ball."""
_MARGIN = 0.02
"""Margin of the box around the figure, for the moves of its face and for outlines, statures."""
_DEPTHS = 4.0
"""Nearest and farthest depth that is drawn, statures before and behind the camera's origin."""
_PER_STATURE = 4096.0
"""Steps of depth a stature, between which outlines are found."""

_SKINNING = """
#version 430
layout(std430, binding = 0) readonly buffer Bones { vec4 rows[]; };
in vec3 bound; in vec3 bound_normal; in uvec4 joints; in vec4 weights;
out vec3 point; out vec3 normal;
vec4 row(uint k) {
    return weights.x * rows[3u * joints.x + k] + weights.y * rows[3u * joints.y + k]
         + weights.z * rows[3u * joints.z + k] + weights.w * rows[3u * joints.w + k];
}
void main() {
    vec4 p = vec4(bound, 1.0), x = row(0u), y = row(1u), z = row(2u);
    point = vec3(dot(x, p), dot(y, p), dot(z, p));
    normal = normalize(vec3(dot(x.xyz, bound_normal), dot(y.xyz, bound_normal), dot(z.xyz, bound_normal)));
}
"""
_SHADOW_VERTEX = """
#version 430
uniform mat4 to_light; in vec3 point; in vec2 uv; out vec2 at;
void main() {
    at = uv;
    gl_Position = to_light * vec4(point, 1.0);
}
"""
_SHADOW_FRAGMENT = """
#version 430
uniform sampler2D picture; uniform float cutoff; in vec2 at;
void main() {
#ifdef MASKED
    if (texture(picture, at).a < cutoff) discard;
#endif
}
"""
_VERTEX = """
#version 430
uniform vec4 window; uniform vec3 light; uniform vec2 tone; uniform float outside;
in vec3 point; in vec3 normal; in vec2 uv; in vec3 tint; in float group;
out vec2 at; out vec4 tint_and_share; out float depth; flat out float group_;
void main() {
    vec3 n = outside * normal;
    float rim = 1.0 - clamp(n.z, 0.0, 1.0), lit = KEY * max(dot(n, light), 0.0);
    float bright = mix(AMBIENT_LOW, AMBIENT_HIGH, 0.5 + 0.5 * n.y) - RIM * rim * rim * rim + lit;
    float shade = sqrt(bright) * (LEAST + SPAN * clamp(point.z * tone.x + tone.y, 0.0, 1.0));
    at = uv; tint_and_share = vec4(tint * shade, 1.0 - sqrt(1.0 - lit / bright)); depth = point.z; group_ = group;
    // Upside down, as pictures begin at the top.
    gl_Position = vec4((point.xy - window.xy) * window.zw * vec2(1.0, -1.0), -point.z / DEPTHS, 1.0);
}
"""
_FRAGMENT = """
#version 430
uniform sampler2D picture; uniform float cutoff;
in vec2 at; in vec4 tint_and_share; in float depth; flat in float group_;
layout(location = 0) out vec4 colour; layout(location = 1) out float key;
void main() {
    colour = tint_and_share;
#ifdef TEXTURED
    vec4 texel = texture(picture, at);
#ifdef MASKED
    if (texel.a < cutoff) discard;
#endif
    colour.rgb *= texel.rgb;
#endif
    key = floor(PER_STATURE * (depth + DEPTHS)) + group_ / 16.0;  // the background's is below 1
}
"""
_SCREEN = """
#version 430
void main() { gl_Position = vec4(vec2((gl_VertexID & 1) * 4 - 1, (gl_VertexID & 2) * 2 - 1), 0.0, 1.0); }
"""
_FINISH = """
#version 430
uniform sampler2D colours; uniform sampler2D keys; uniform sampler2DShadow shadow;
uniform mat4 to_light; uniform vec4 window; uniform vec2 pixel;
out vec4 shown;
float most(vec4 v) { return max(max(v.x, v.y), max(v.z, v.w)); }
void main() {
    vec2 at = gl_FragCoord.xy * pixel;
    vec4 own = textureGather(keys, at);
    vec4 right = textureGather(keys, at + vec2(pixel.x, 0.0)), left = textureGather(keys, at - vec2(pixel.x, 0.0));
    vec4 below = textureGather(keys, at + vec2(0.0, pixel.y)), above = textureGather(keys, at - vec2(0.0, pixel.y));
    vec4 nearest = max(max(right, left), max(below, above));
    float group = fract(own.x);
    vec4 beside = vec4(right.x, left.x, below.x, above.x), groups = fract(beside);
    vec4 meets = step(0.03, abs(groups - group)) * step(0.03, groups) * step(own.x - STEP * PER_STATURE, beside);
    float meeting = group > 0.03 && own.x > 1.0 && dot(meets, step(1.0, beside)) > 0.0 ? 0.73 : 1.0;
    vec4 lines = mix(vec4(meeting), vec4(0.43), greaterThan(nearest - STEP * PER_STATURE, own));
    vec2 place = (at * 2.0 - 1.0) / window.zw * vec2(1.0, -1.0) + window.xy;
    vec3 seen = 0.5 + 0.5 * (to_light * vec4(place, most(own) / PER_STATURE - DEPTHS, 1.0)).xyz - vec3(0.0, 0.0, BIAS);
    vec3 aside = vec3(vec2(0.5 / SHADOW_PX), 0.0);
    float dimmed = 1.0 - 0.5 * (texture(shadow, seen + aside) + texture(shadow, seen - aside));
    vec4 colour = texture(colours, at);
    shown = vec4(colour.rgb * (1.0 - dimmed * colour.a) * dot(lines, vec4(0.25)), 1.0);
}
"""


class Renderer:
    """A thread's context of OpenGL. Raises whatever moderngl raises if the machine has no EGL."""

    def __init__(self) -> None:
        self.gl: Any = import_module("moderngl")
        self.context: Any = self.gl.create_context(standalone=True, backend="egl", require=430)
        self.context.gc_mode = "context_gc"  # other threads may drop what belongs to this one's context
        self._models: WeakKeyDictionary[Skin, _SkinBuffers] = WeakKeyDictionary()
        shadow = self.context.depth_texture((_SHADOW_PX, _SHADOW_PX))
        shadow.compare_func, shadow.repeat_x, shadow.repeat_y = "<=", False, False
        self._shadow = self.context.framebuffer(depth_attachment=shadow)
        self.white = self.context.texture((1, 1), 4, b"\xff" * 4)
        self._targets = cache(self._make_targets)
        self._finish = self.program(_SCREEN, _FINISH)
        self._triangle = self.context.vertex_array(self._finish, [])
        self.skinning = self.program(_SKINNING, None, varyings=("point", "normal"))
        self.surface_program = cache(self.program)

    def program(self, vertex: str, fragment: str | None, *defined: str, **options: Any) -> Any:
        """Compile a program; its capital names stand for this module's and ``raster``'s constants."""
        constants = {
            "SHADOW_PX": float(_SHADOW_PX), "DEPTHS": _DEPTHS, "KEY": KEY, "RIM": RIM,
            "AMBIENT_LOW": AMBIENT[0], "AMBIENT_HIGH": AMBIENT[1], "LEAST": DEPTH_TONE[0], "SPAN": DEPTH_TONE[1],
            "STEP": OUTLINE_STEP, "PER_STATURE": _PER_STATURE, "BIAS": _BIAS, **dict.fromkeys(defined, 1),
        }  # fmt: skip
        head = "\n".join(f"#define {name} {value}" for name, value in constants.items())
        sources = [text and text.replace("#version 430", f"#version 430\n{head}") for text in (vertex, fragment)]
        return self.context.program(vertex_shader=sources[0], fragment_shader=sources[1], **options)

    def _make_targets(self, width: int, height: int) -> tuple[Any, Any]:
        """Return the buffers of a size: that of all samples, and that of the picture."""
        factor = _FINE if width * height <= _SMALL_PX else _COARSE
        size = round(factor * width), round(factor * height)
        colours, keys = self.context.texture(size, 4), self.context.texture(size, 1, dtype="f4")
        for texture in (colours, keys):
            texture.repeat_x = texture.repeat_y = False
        large = self.context.framebuffer([colours, keys], self.context.depth_renderbuffer(size))
        return large, self.context.simple_framebuffer((width, height), 4)

    def draw(self, skin: Skin, vertices: Pixels, bones: Pixels, view: Camera, hand: str | None) -> NDArray[np.uint8]:
        """Return a picture (H, W, 3), 0..255, of a skin with ``vertices`` (V, 3) in its bind pose and ``bones``
        (J, 3, 4) from there to camera axes, statures. ``hand``: "left" or "right", to draw only that hand.
        """
        context, gl = self.context, self.gl
        context.gc()
        if skin not in self._models:
            self._models[skin] = _SkinBuffers(self, skin)
        model = self._models[skin]
        self._shadow.use()  # OpenGL also skins with a framebuffer only
        model.place(vertices, bones)
        samples, picture = self._targets(view.width, view.height)
        to_light = _to_light(view)
        box = model.box(bones, view)
        context.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
        self._shadow.clear(depth=1.0)
        context.front_face = "ccw"
        for surface in model.surfaces:
            surface.draw(True, True, hand, to_light=to_light)
        samples.use()
        samples.clear(*BACKGROUND, 0.0)
        span = max(view.near - view.far, 1e-6)
        tone = 1.0 / span, -view.far / span
        window = (*view.centre, 2.0 * view.scale / view.width, 2.0 * view.scale / view.height)
        for outside in (True, False):  # what is seen from inside mostly lies behind
            context.front_face = "cw" if outside else "ccw"
            for surface in model.surfaces:
                surface.draw(False, outside, hand, window=window, light=tuple(view.light), tone=tone)
        picture.use()
        picture.clear(*BACKGROUND)
        context.scissor = box
        for unit, texture in enumerate(samples.color_attachments):
            texture.use(unit)
        self._shadow.depth_attachment.use(2)
        pixel = 1.0 / view.width, 1.0 / view.height
        values = {"colours": 0, "keys": 1, "shadow": 2, "to_light": to_light, "window": window, "pixel": pixel}
        for name, value in values.items():
            self._finish[name] = value
        context.enable_only(gl.NOTHING)
        self._triangle.render(gl.TRIANGLES, 3)
        context.scissor = None
        shown = np.frombuffer(picture.read(components=4), np.uint8).reshape(view.height, view.width, 4)
        return shown[..., :3].copy()


def _to_light(view: Camera) -> tuple[float, ...]:
    """Return the matrix (4 x 4, by columns) from camera axes to the shadow map's, where the view's ball is -1 to 1."""
    right = np.cross([0.0, 1.0, 0.0], view.light)
    right /= np.linalg.norm(right)
    centre, radius = view.ball
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(view.light, right), -view.light]) / radius
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return tuple(matrix.T.ravel().tolist())


class _SkinBuffers:
    """A skin in the buffers of a context.

    surfaces: its surfaces.
    """

    def __init__(self, renderer: Renderer, skin: Skin) -> None:
        context = renderer.context
        n = len(skin.vertices)
        joints, weights = skin.weights.indices.reshape(n, -1), skin.weights.data.reshape(n, -1)
        carried, shown = np.empty(n, "3f4,4u2,4f4"), np.empty(n, "2f4,3f4,f4")
        tints, groups = np.empty((n, 3), np.float32), np.empty(n, np.float32)
        tints[skin.triangles] = skin.tints[:, None]
        groups[skin.triangles[:, 0]] = skin.groups
        for rows, columns in ((carried, (skin.normals, joints, weights)), (shown, (skin.uvs, tints, groups))):
            for name, values in zip(rows.dtype.names or (), columns, strict=True):
                rows[name] = values
        used = weights > 0.0
        self._corners = np.full((len(skin.positions), 2, 3), np.nan, np.float32)  # (J, 2, 3) of boxes around vertices
        for k, limit in enumerate((np.fmin, np.fmax)):
            limit.at(self._corners[:, k], joints[used], np.repeat(skin.vertices, used.sum(axis=1), axis=0))
        self._placed: Pixels | None = None
        self._vertices, self._bones = context.buffer(reserve=12 * n), context.buffer(reserve=48 * len(skin.positions))
        self._skinned = context.buffer(reserve=24 * n)
        bound = [
            (self._vertices, "3f", "bound"),
            (context.buffer(carried), "3f 4u2 4f", "bound_normal", "joints", "weights"),
        ]
        self._skinning = context.vertex_array(renderer.skinning, bound)
        arrays = [
            (self._skinned, "3f 3f", "point", "normal"),
            (context.buffer(shown), "2f 3f 1f", "uv", "tint", "group"),
        ]
        # Clothes follow the body in files: drawn first, they hide it.
        self.surfaces = [_SurfaceBuffers(renderer, skin, surface, arrays) for surface in reversed(skin.surfaces)]

    def place(self, vertices: Pixels, bones: Pixels) -> None:
        """Carry the vertices (V, 3) by the bones (J, 3, 4)."""
        if vertices is not self._placed:
            self._vertices.write(vertices)
            self._placed = vertices
        self._bones.write(bones)
        self._bones.bind_to_storage_buffer(0)
        self._skinning.transform(self._skinned)

    def box(self, bones: Pixels, view: Camera) -> tuple[int, int, int, int]:
        """Return left, top, width and height, pixels, of a box around the figure: each vertex lies among the places to
        which its joints carry the box around their vertices.
        """
        low, high = self._corners[:, 0], self._corners[:, 1]
        middle = np.einsum("jab,jb->ja", bones[:, :2, :3], 0.5 * (low + high)) + bones[:, :2, 3]
        reach = np.einsum("jab,jb->ja", np.abs(bones[:, :2, :3]), 0.5 * (high - low)) + _MARGIN
        size = np.array([view.width, view.height])
        edges = np.stack([np.nanmin(middle - reach, axis=0), np.nanmax(middle + reach, axis=0)])
        at = (edges - view.centre) * view.scale + 0.5 * size
        (left, bottom), (right, top) = np.clip(at, 0, size).astype(int).tolist()
        return left, view.height - top, right - left, top - bottom


class _SurfaceBuffers:
    """A surface of a skin in the buffers of a context; ``arrays``: of the skin's vertices."""

    def __init__(self, renderer: Renderer, skin: Skin, surface: Surface, arrays: list[Any]) -> None:
        self._renderer, self._surface, self._arrays = renderer, surface, arrays
        self._triangles, self._hands = skin.triangles[surface.triangles], skin.hands[surface.triangles]
        self._array = cache(self._make_array)
        self._texture, pixels = renderer.white, surface.pixels
        if pixels is not None:
            gl, (height, width) = renderer.gl, pixels.shape[:2]
            self._texture = renderer.context.texture((width, height), 4, pixels.tobytes())
            self._texture.build_mipmaps()
            self._texture.filter = gl.LINEAR_MIPMAP_NEAREST, gl.LINEAR

    def _make_array(self, casts: bool, hand: str | None) -> Any:
        context = self._renderer.context
        triangles = self._triangles if hand is None else self._triangles[self._hands == hand]
        defined = [] if self._surface.pixels is None else ["TEXTURED"]
        sources = (_SHADOW_VERTEX, _SHADOW_FRAGMENT) if casts else (_VERTEX, _FRAGMENT)
        program = self._renderer.surface_program(*sources, *defined, *["MASKED"] * (self._surface.cutoff > 0.0))
        # The last corner's group counts.
        index = context.buffer(np.ascontiguousarray(triangles[:, [1, 2, 0]], np.uint32)) if len(triangles) else None
        return None if index is None else context.vertex_array(program, self._arrays, index, skip_errors=True)

    def draw(self, casts: bool, outside: bool, hand: str | None, **uniforms: Any) -> None:
        """Draw its outside, or its inside if that is visible, or with ``casts`` their shadow, with these values of the
        program's uniforms.
        """
        array = self._array(casts, hand) if outside or self._surface.both_sides else None
        if array is None:
            return
        self._texture.use(0)
        uniforms |= {"picture": 0, "cutoff": self._surface.cutoff, "outside": 1.0 if outside else -1.0}
        for name, value in uniforms.items():
            if name in array.program:
                array.program[name] = value
        array.render(self._renderer.gl.TRIANGLES)


_OF_THREAD = local()


def renderer() -> Renderer | None:
    """Return this thread's renderer; None without moderngl or EGL."""
    if not hasattr(_OF_THREAD, "renderer"):
        try:
            _OF_THREAD.renderer = Renderer()
        except Exception:  # moderngl raises its own errors and Exception itself
            _OF_THREAD.renderer = None
    found: Renderer | None = _OF_THREAD.renderer
    return found
