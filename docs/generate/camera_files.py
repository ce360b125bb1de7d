"""The table of camera file formats in docs/reference/files.md."""

from generate.markdown import code, table

from v3studio.studio.camera_files import CAMERA_FORMATS

MARK = "<!-- the table CAMERA_FORMATS of studio/camera_files/__init__.py -->"


def with_camera_formats(page: str) -> str:
    """The page with the table in the place of `MARK`."""
    rows = [(form.title, ", ".join(map(_name, form.written)), form.notes) for form in CAMERA_FORMATS]
    return page.replace(MARK, "\n".join(table(("Format", "Written as", "Notes"), *rows)))


def _name(pattern: str) -> str:
    return code(pattern) if pattern else "a folder"
