"""The file or folder that an export or a share writes, as chosen in a dialog."""

from pathlib import Path
from typing import ClassVar


class NamedTarget:
    """Base of the requests of dialogs with a field for the target. `done`: what it is called afterwards; `stays`:
    whether the notice that it is done stays until it is dismissed."""

    does: ClassVar[str] = "Export"
    done: ClassVar[str] = "Written"
    stays: ClassVar[bool] = False
    folder: Path
    _target: str

    @property
    def usual_name(self) -> str:
        """File or folder name until another one is typed."""
        raise NotImplementedError

    @property
    def target(self) -> str:
        """File or folder to write; named by `usual_name` until another name is typed."""
        return self._target or str(self.folder / self.usual_name)

    @property
    def path(self) -> Path:
        """`target`, absolute."""
        return Path(self.target.strip()).expanduser().absolute()

    def set_target(self, text: str) -> None:
        self._target = "" if text.strip() == self.target else text

    def move_to(self, folder: Path) -> None:
        """Write to another folder under the same name."""
        if self._target:
            self._target = str(folder / Path(self._target.strip()).name)
        self.folder = folder
