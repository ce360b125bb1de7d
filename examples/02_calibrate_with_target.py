"""Calibrate cameras with a ChArUco board.

The board is rendered from known cameras, so that the result can be compared with ground truth. With real footage, pass
`detect_target` a function per camera that reads a frame as an (H, W, 3) uint8 RGB array.
"""

import argparse

import cv2
import numpy as np

import v3studio as v3

TARGET = v3.calibration.CalibrationTarget(columns=8, rows=5, square=0.06, marker=0.045)
WIDTH, HEIGHT = 640, 480
K = np.array([[600.0, 0, WIDTH / 2], [0, 600.0, HEIGHT / 2], [0, 0, 1]])


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) world_to_camera, OpenCV axes, world z up."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ eye
    return pose


def target_pose(frame: int) -> np.ndarray:
    """(4, 4) board to world; the board faces the cameras, rotates and moves."""
    rng = np.random.default_rng(frame)
    rotation = cv2.Rodrigues(rng.uniform(-0.35, 0.35, 3))[0]
    upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x right, y (rows) down, z away from the cameras
    pose = np.eye(4)
    pose[:3, :3] = rotation @ upright
    pose[:3, 3] = rng.uniform([-0.15, -0.1, -0.12], [0.15, 0.1, 0.12])
    return pose


def photograph(camera: v3.Camera, frame: int) -> np.ndarray:
    """(H, W, 3) uint8 RGB: the board as this camera sees it."""
    pixels = 40  # per square
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    flat = cv2.aruco.CharucoBoard(
        (TARGET.columns, TARGET.rows), TARGET.square, TARGET.marker, dictionary
    ).generateImage((TARGET.columns * pixels, TARGET.rows * pixels))
    flat = cv2.copyMakeBorder(flat, pixels, pixels, pixels, pixels, cv2.BORDER_CONSTANT, value=255)
    width, height = TARGET.columns * TARGET.square, TARGET.rows * TARGET.square
    s = TARGET.square / pixels  # meters per pixel of the flat image
    place = np.array([[s, 0, -TARGET.square - width / 2], [0, s, -TARGET.square - height / 2], [0, 0, 0], [0, 0, 1]])
    homography = K @ (camera.world_to_camera @ target_pose(frame) @ place)[:3]
    gray = cv2.warpPerspective(flat, homography, (WIDTH, HEIGHT), flags=cv2.INTER_AREA, borderValue=127)
    return np.repeat(cv2.GaussianBlur(gray, (3, 3), 0)[:, :, None], 3, axis=2)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    eyes = {"left": [-0.7, -1.3, 0.1], "middle": [0.0, -1.5, 0.2], "right": [0.7, -1.3, 0.0]}
    truth = v3.Rig(
        tuple(
            v3.Camera(name=name, width=WIDTH, height=HEIGHT, K=K, world_to_camera=look_at(np.array(eye), np.zeros(3)))
            for name, eye in eyes.items()
        )
    )
    frames = range(12)
    views, sizes = v3.calibration.detect_target(
        {camera.name: (lambda frame, camera=camera: photograph(camera, frame)) for camera in truth},
        dict.fromkeys(truth.names, frames),
        TARGET,
    )
    print(f"The board was found in {len(views)} of {len(frames) * len(truth)} images.")

    result = v3.calibration.calibrate_from_target(TARGET, views, sizes)

    aligned = v3.calibration.align_rigs(result.rig, truth).rig(result.rig)
    for camera in truth:
        distance = np.linalg.norm(aligned[camera.name].center - camera.center)
        print(f"{camera.name}: center {1000 * distance:.2f} mm off, fx {result.rig[camera.name].fx:.1f} px")
        assert distance < 0.01


if __name__ == "__main__":
    main()
