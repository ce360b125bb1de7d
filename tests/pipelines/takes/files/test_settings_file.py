from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.config import load_config
from v3studio.pipelines.takes.files.settings_file import save_config, set_settings
from v3studio.studio.yaml_text import BOUNDS

TEXT = """\
# my capture
train:
  group_size: 15 # two groups
  max_splats: 36000

bake: {quality: 24} # a little lossy
capture:
  root: /footage
  held_out: [cam05, cam12]  # never trained on
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "mine.yaml").write_text(TEXT)
    return tmp_path / "mine.yaml"


def test_only_the_changed_value_changes(file: Path) -> None:
    set_settings(file, {"train.group_size": 10})
    before, after = TEXT.splitlines(), file.read_text().splitlines()
    changed = [new for old, new in zip(before, after, strict=True) if old.split() != new.split()]
    assert changed == ["  group_size: 10 # two groups"]
    assert load_config(file).train.group_size == 10


@pytest.mark.parametrize("damaged", ["{", "[1, 2]", "bake: {qp: 24}\nbake: {qp: 25}\n", "unknown: {x: 1}\n"])
def test_a_file_that_cannot_be_kept_is_replaced(file: Path, damaged: str) -> None:
    config = load_config(file)
    file.write_text(damaged)
    save_config(file, config)
    assert load_config(file) == config


BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, 40))


@pytest.mark.parametrize(
    "hostile",
    [BOMB, "a: " + "[" * 200 + "]" * 200, "a: " + "[" * 50_000, "a: &a [*a]", "x" * (BOUNDS.size + 1), "a: [1"],
    ids=["aliases", "nested", "unclosed", "recursive", "large", "syntax"],
)
def test_hostile_files_are_refused_and_stay(file: Path, hostile: str) -> None:
    file.write_text(hostile)
    with refuses("settings.not_yaml", file=file):
        set_settings(file, {"bake.quality": 3})
    assert file.read_text() == hostile
    assert list(file.parent.iterdir()) == [file]
