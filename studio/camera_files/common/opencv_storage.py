"""Files in OpenCV's FileStorage format, XML or YAML."""

from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.camera_files.common import read_text
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.json_types import JsonObject


def read_storage(path: Path) -> JsonObject:
    """The values of a file: objects, lists, numbers and text; matrices are nested lists."""
    import cv2

    text = read_text(path)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        keys = list(root.keys())
    except (cv2.error, SystemError) as error:  # OpenCV 5's bindings raise SystemError for some errors
        reason = str(error.__cause__ or error).split("error:")[-1].strip().splitlines()[0]
        problem = f"OpenCV cannot parse the file ({reason})"
        fix = "The file may be truncated: export the cameras again."
        raise StudioError("camera_file.syntax", problem, file=path, fix=fix) from None
    with naming(path):
        return {key: _value(root.getNode(key), key) for key in keys}


def _value(node: Any, key: str) -> Any:
    import cv2

    if node.isMap():
        keys = set(node.keys())
        if not {"rows", "cols", "sizes"} & keys:
            return {inner: _value(node.getNode(inner), inner) for inner in keys}
        try:
            matrix = node.mat()
        except cv2.error:
            matrix = None
        if matrix is None:
            problem, fix = f"'{key}' is not a complete matrix", "Export the cameras again."
            raise StudioError("camera.not_a_matrix", problem, fix=fix, key=key)
        return np.asarray(matrix, np.float64).tolist()
    if node.isSeq():
        return [_value(node.at(index), key) for index in range(node.size())]
    if node.isInt() or node.isReal():
        value = node.real()
        return int(value) if node.isInt() else value
    return node.string() if node.isString() else None
