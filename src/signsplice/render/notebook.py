"""Shows a clip in a notebook: an animated drawing of its signer, without further packages."""

from __future__ import annotations

from html import escape

import numpy as np

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.mesh import colour
from signsplice.motion import Clip
from signsplice.render.picture import make_scene

_RATE = 12.5
"""Drawn frames a second; the browser interpolates between them."""
_MOST_POSITIONS = 10_000
"""Largest number of drawn capsule positions, which limits the size of a long clip's drawing."""
_HEIGHT = 400
"""Height of the drawing, about in pixels."""
_OUTLINE = 3
"""Stroke width of a part's dark outline minus the part's, in the units of ``_HEIGHT``; shirts have no outline."""
_PAGE = """<style>body{{margin:0;font:14px sans-serif}}svg{{display:block;height:{height}px;margin:auto}}\
path,use{{fill:none;stroke-linecap:round}}</style>{drawing}<button>Pause</button> \
<input type=range min=0 max={seconds} step=.01 value=0 aria-label="Time" style="width:60%"><script>
const s=document.querySelector("svg"),b=document.querySelector("button"),r=document.querySelector("input")
const show=on=>{{on?s.unpauseAnimations():s.pauseAnimations();b.textContent=on?"Pause":"Play"}}
b.onclick=()=>show(s.animationsPaused())
r.oninput=()=>{{show(false);s.setCurrentTime(r.value)}}
setInterval(()=>{{if(!s.animationsPaused())r.value=s.getCurrentTime()%{seconds}}},50)
if(matchMedia("(prefers-reduced-motion: reduce)").matches)show(false)
</script>"""


def html(clip: Clip) -> str:
    """Returns the signer of a clip from the front as an animated SVG, below 300 kB, in a sandboxed iframe with a button
    and a slider. The animation also runs without scripts.
    """
    page = _PAGE.format(drawing=drawing(clip), height=_HEIGHT, seconds=f"{clip.seconds:.3f}")
    return (
        f'<iframe srcdoc="{escape(page)}" sandbox="allow-scripts" title="{escape(clip.name)}" '
        f'style="width: 100%; height: {_HEIGHT + 40}px; border: 1px solid #ccc"></iframe><br>'
        f"<code>{escape(repr(clip))}</code>"
    )


def drawing(clip: Clip) -> str:
    """Draws the capsules of a clip's signer as animated SVG lines: legs first, then from the farthest to the nearest by
    median depth.
    """
    scene, body = make_scene(clip), body_capsules(clip.skeleton)
    n_drawn = int(np.clip(round(clip.seconds * _RATE) + 1, 2, max(2, _MOST_POSITIONS // max(1, len(body.parts)))))
    frames = np.linspace(0, len(clip) - 1, n_drawn).round().astype(int)
    left, right, bottom, top = scene.window
    scale = _HEIGHT / (top - bottom)
    ends = np.stack(capsule_ends(body, scene.rotations[frames], scene.positions[frames]), axis=2)  # (N, C, 2, 3)
    points = (ends - scene.origin) @ scene.axes.T / scene.height
    pixels = ((points[..., :2] - (left, top)) * (scale, -scale)).round().astype(int)  # (N, C, 2, 2)
    widths = (2.0 * scale / scene.height * body.radii.mean(axis=1)).tolist()
    is_leg = np.isin(body.parts, ("leg", "shoe"))
    lines = []
    for k in np.lexsort((np.median(points[..., 2], axis=(0, 2)), ~is_leg)).tolist():
        paths = [f"M{a} {b}L{c} {d}" for a, b, c, d in pixels[:, k].reshape(-1, 4).tolist()]
        tint = "".join(f"{round(255 * part):02x}" for part in colour(body.parts[k], body.sides[k]))
        moves = f"dur={clip.seconds:.3f}s repeatCount=indefinite values='{';'.join(paths)}'"
        lines.append(
            f"<defs><path id=p{k} d='{paths[0]}'><animate attributeName=d {moves} /></path></defs>"
            f"<use href=#p{k} stroke=#333 stroke-width={widths[k] + _OUTLINE * (body.parts[k] != 'shirt'):.1f} />"
            f"<use href=#p{k} stroke=#{tint} stroke-width={widths[k]:.1f} />"
        )
    size = f"viewBox='0 0 {round(scale * (right - left))} {_HEIGHT}'"
    return f"<svg {size} role=img aria-label='{escape(clip.name)}'>{''.join(lines)}</svg>"
