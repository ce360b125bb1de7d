"""3D points, lines and textured quads drawn with NumPy and OpenCV, without a GPU."""

import cv2
import numpy as np

from gui.drawing.canvas import Canvas
from gui.drawing.palette import RGB
from studio.cameras import Camera

NEAR = 1e-3


def draw_points(canvas: Canvas, camera: Camera, points: np.ndarray, colors: np.ndarray, radius: int = 1) -> None:
    """Draw (N, 3) world points as squares of 2 * radius - 1 pixels, nearer ones over farther ones."""
    pixels, depth = camera.project(points)
    inside = (depth > NEAR) & (np.abs(pixels) < 1e6).all(axis=1)
    order = np.argsort(-depth[inside], kind="stable")
    place = np.floor(pixels[inside][order]).astype(int)
    color = colors[inside][order]
    for dy in range(1 - radius, radius):
        for dx in range(1 - radius, radius):
            x, y = place[:, 0] + dx, place[:, 1] + dy
            good = (x >= 0) & (y >= 0) & (x < canvas.width) & (y < canvas.height)
            canvas.pixels[y[good], x[good]] = color[good]


def draw_line(
    canvas: Canvas, camera: Camera, start: np.ndarray, end: np.ndarray, color: RGB, thickness: int = 1
) -> None:
    """Draw a line between two world points, clipped at the camera's plane."""
    ends = np.stack([start, end])
    depth = ends @ camera.rotation[2] + camera.translation[2]
    if (depth <= NEAR).all():
        return
    if (depth <= NEAR).any():
        behind = int(np.argmin(depth))
        share = (NEAR * 2 - depth[behind]) / (depth[1 - behind] - depth[behind])
        ends[behind] = ends[behind] + share * (ends[1 - behind] - ends[behind])
    canvas.line(camera.project(ends)[0], color, thickness)


def draw_quad(canvas: Canvas, camera: Camera, corners: np.ndarray, picture: np.ndarray, opacity: float = 1.0) -> None:
    """Draw an image on four world points, clockwise from the upper left; nothing if one is behind the camera."""
    pixels, depth = camera.project(corners)
    if (depth <= NEAR).any() or np.abs(pixels).max() > 20 * max(canvas.width, canvas.height):
        return
    height, width = picture.shape[:2]
    here = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    warp = cv2.getPerspectiveTransform(here, pixels.astype(np.float32))
    size = (canvas.width, canvas.height)
    cover = cv2.warpPerspective(np.full((height, width), 255, np.uint8), warp, size)
    if not cover.any():
        return
    warped = cv2.warpPerspective(picture, warp, size, flags=cv2.INTER_LINEAR)
    alpha = cover[..., None].astype(np.float32) * (opacity / 255)
    canvas.pixels[:] = (canvas.pixels + (warped.astype(np.float32) - canvas.pixels) * alpha + 0.5).astype(np.uint8)


def frustum(camera: Camera, length: float) -> tuple[np.ndarray, np.ndarray]:
    """The optical center (3,) and the image's corners (4, 3) at a distance, in world coordinates."""
    image = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]], float)
    rays = np.column_stack([(image[:, 0] - camera.cx) / camera.fx, (image[:, 1] - camera.cy) / camera.fy, np.ones(4)])
    return camera.center, camera.center + (rays * length) @ camera.rotation


def draw_frustum(
    canvas: Canvas,
    view: Camera,
    camera: Camera,
    length: float,
    color: RGB,
    picture: np.ndarray | None = None,
    thickness: int = 1,
) -> None:
    """Draw a camera's frustum with its image."""
    center, corners = frustum(camera, length)
    if picture is not None:
        draw_quad(canvas, view, corners, picture, 0.9)
    for number in range(4):
        draw_line(canvas, view, center, corners[number], color, thickness)
        draw_line(canvas, view, corners[number], corners[(number + 1) % 4], color, thickness)
