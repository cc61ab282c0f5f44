"""Preview of a scene: its bodies as the camera frames them, shaded, without heat."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw

from ...geometry.vectors import row_dot, unit_vectors
from ..surface.abstract_camera import AbstractCamera
from ..surface.facets import smooth_normals
from ..surface.visible import VisiblePoints, WorldMesh, visible_points
from .canvas import FAINT, INK, PAPER, Layout, averaged
from .label_places import label_places


# Samples of a pixel along each axis.
_SAMPLES = 2
_BACKGROUND = (32, 34, 40)
# sRGB of the bodies, used again after the last one.
_BODIES = ((206, 200, 188), (150, 184, 208), (208, 168, 136), (164, 196, 152))
# sRGB of the axes x, y, z, and the shortest arrow that still has a direction [-].
_AXES = (("x", (236, 96, 84)), ("y", (112, 204, 112)), ("z", (112, 160, 255)))
_MIN_ARROW = 0.08
# Length of an arrow, and of the square that all axes lie in, in heights of the text.
_ARROW_LENGTH = 2.6
_AXES_SIZE = 5.0


def draw_preview(
    bodies: Sequence[WorldMesh],
    camera: AbstractCamera,
    title: str = "",
    names: Sequence[str] = (),
) -> tuple[Image.Image, list[int]]:
    """Draw bodies with a light at the camera, their names, and the world's axes.

    Args:
        bodies: their meshes in the world.
        camera: of the frames.
        title: text below the image.
        names: of the bodies; one without a name, or all if there are none, are called
            by their numbers.

    Returns:
        The picture, and the numbers of the bodies in it.

    Raises:
        InputError: if the camera is inside a solid body or sees none.
    """
    fine = camera.finer(_SAMPLES)
    visible = visible_points(tuple(bodies), fine)
    colours = _shaded(bodies, visible, fine)
    width, height = camera.size
    pixels = averaged(colours, _SAMPLES)
    layout = Layout.of(height, width)
    strip = round(1.3 * layout.text) + layout.gap
    canvas = Image.new("RGB", (width, height + strip), PAPER)
    canvas.paste(Image.fromarray(pixels), (0, 0))
    drawn_bodies = np.unique(visible.body).tolist()
    if len(bodies) > 1:
        named = dict(enumerate(names))
        labels = {n: named.get(n) or f"body {n}" for n in drawn_bodies}
        _draw_labels(canvas, visible=visible, fine=fine, labels=labels, layout=layout)
    _draw_axes(canvas, camera, layout)
    caption = layout.shorten(title, width - 2 * layout.gap)
    at = (width - layout.gap, height + strip // 2)
    ImageDraw.Draw(canvas).text(at, caption, FAINT, layout.font, anchor="rm")
    return canvas, drawn_bodies


def _shaded(
    bodies: Sequence[WorldMesh], visible: VisiblePoints, camera: AbstractCamera
) -> UInt8[np.ndarray, "h w 3"]:
    colours = np.empty(visible.position.shape, np.uint8)
    to_eye = unit_vectors(np.asarray(camera.position) - visible.position)
    for number, body in enumerate(bodies):
        on_body = np.flatnonzero(visible.body == number)
        # The back of a thin wall has the normals of its front, turned round.
        normal = smooth_normals(
            body.vertices,
            faces=body.faces,
            face=visible.face[on_body] % len(body.faces),
            points=visible.position[on_body],
        )
        facing = row_dot(normal, to_eye[on_body])
        # A face that is wound the wrong way round is lit from both sides.
        light = 0.2 + 0.8 * np.abs(facing)[:, None]
        base = np.array(_BODIES[number % len(_BODIES)])
        colours[on_body] = np.rint(light * base)
    return camera.frame_of(visible.pixel, colours, _BACKGROUND)


def _draw_labels(
    canvas: Image.Image,
    visible: VisiblePoints,
    fine: AbstractCamera,
    labels: Mapping[int, str],
    layout: Layout,
) -> None:
    texts = [
        layout.shorten(label, canvas.width - 2 * layout.gap)
        for label in labels.values()
    ]
    areas = []
    for number in labels:
        row, column = np.divmod(visible.pixel[visible.body == number], fine.width)
        areas.append(np.stack([column, row], axis=1) / _SAMPLES)
    height = fine.height // _SAMPLES
    # The axes are in the lower left corner.
    axes = _AXES_SIZE * layout.text
    places = label_places(
        areas,
        half_sizes=[
            np.array([layout.width(text) / 2 + layout.gap, layout.text / 2])
            for text in texts
        ],
        picture=np.array([[0, 0], [canvas.width, height]], float),
        taken=np.array([[0, height - axes], [axes, height]], float),
    )
    draw = ImageDraw.Draw(canvas)
    for text, place in zip(texts, places, strict=True):
        if place is not None:
            _draw_text(draw, at=place, text=text, ink=INK, layout=layout)


def _draw_axes(canvas: Image.Image, camera: AbstractCamera, layout: Layout) -> None:
    # In the lower left corner, seen along the middle ray of the camera.
    draw = ImageDraw.Draw(canvas)
    length = _ARROW_LENGTH * layout.text
    # World axes x, y, z as rows, in steps to the right, down and away.
    axes = camera.frame.T
    flat = np.hypot(axes[:, 0], axes[:, 1])
    # One along the view is a spot: its name goes where no arrow is.
    spare = -axes[flat >= _MIN_ARROW, :2].sum(axis=0)
    way = np.where(flat[:, None] < _MIN_ARROW, spare, axes[:, :2])
    way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    tip = length * np.where(flat < _MIN_ARROW, 0.0, 1.0)[:, None] * axes[:, :2]
    at = tip + 0.9 * layout.text * way
    names = [f"{name} up" if name == "z" else name for name, _ in _AXES]
    wide = np.array([layout.width(name) for name in names])
    # Labels beside the heads of their arrows, not across them.
    at[:, 0] += np.where(np.abs(way[:, 0]) > 0.5, np.sign(way[:, 0]) * wide / 2, 0.0)
    half = np.stack([wide / 2, np.full(3, layout.text / 2)], axis=1)
    corner = np.array([layout.gap, camera.height - layout.gap])
    low = np.minimum((at - half).min(axis=0), 0.0)
    high = np.maximum((at + half).max(axis=0), 0.0)
    origin = corner - [low[0], high[1]]
    # The farthest first, so that the nearer ones are in front.
    for k in np.argsort(-axes[:, 2]).tolist():
        _, colour = _AXES[k]
        if flat[k] < _MIN_ARROW:
            spot = layout.text / 5
            draw.ellipse((*(origin - spot), *(origin + spot)), fill=colour)
        else:
            _draw_arrow(
                draw, start=origin, tip=origin + tip[k], colour=colour, layout=layout
            )
        _draw_text(draw, at=origin + at[k], text=names[k], ink=colour, layout=layout)


def _draw_text(draw, at, text: str, ink: tuple[int, int, int], layout: Layout) -> None:
    # With a dark rim, or bodies behind it would hide it.
    rim = {"stroke_width": layout.line + 1, "stroke_fill": PAPER}
    draw.text(tuple(at), text, ink, layout.font, anchor="mm", **rim)


def _draw_arrow(
    draw: ImageDraw.ImageDraw,
    start: np.ndarray,
    tip: np.ndarray,
    colour: tuple[int, int, int],
    layout: Layout,
) -> None:
    along = (tip - start) / np.hypot(*(tip - start))
    across = np.array([-along[1], along[0]])
    head = min(0.45 * layout.text, float(np.hypot(*(tip - start))))
    neck = tip - head * along
    draw.line((*start, *neck), fill=colour, width=layout.line + 1)
    corners = [tip, neck + 0.5 * head * across, neck - 0.5 * head * across]
    draw.polygon([tuple(corner) for corner in corners], fill=colour)
