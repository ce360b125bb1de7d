"""A kept bake becomes the take's stream again; what is refused changes nothing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from pipelines.config import load_config
from pipelines.takes.chosen_bake import choose_bake, remarks
from pipelines.takes.kept_bakes import keep_bake
from pipelines.takes.take import Take
from tests.support.errors import refuses


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def take(finished: Path, tmp_path: Path) -> Take:
    return Take.open(Path(shutil.copytree(finished / "take", tmp_path / "take")))


def test_a_stream_that_is_not_kept_is_not_lost(take: Take) -> None:
    keep_bake(take, "fine")
    (take.stream / "manifest.json").unlink()
    (take.stream / "manifest.json").write_text("{}")
    with refuses("bakes.would_be_lost"):
        choose_bake(take, "fine")
    assert (take.stream / "manifest.json").read_text() == "{}"
    choose_bake(take, "fine", discard=True)
    assert contents(take.stream) == contents(take.bakes / "fine" / "stream")


def test_an_interrupted_choice_is_repeated(take: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    keep_bake(take, "fine")
    before, kept = contents(take.stream), contents(take.bakes)

    def killed(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("pipelines.takes.chosen_bake._put_stream", killed)
        with pytest.raises(KeyboardInterrupt):
            choose_bake(take, "fine")
    assert contents(take.bakes) == kept
    assert choose_bake(take, "fine").chosen
    assert contents(take.stream) == before


def test_a_stream_that_is_kept_only_with_damage_is_not_lost(take: Take) -> None:
    keep_bake(take, "fine")
    shutil.copytree(take.bakes / "fine", take.bakes / "same")
    path = next((take.bakes / "fine" / "stream" / "files").iterdir())
    path.unlink()  # the take's stream shares the file
    path.write_bytes(b"damaged")
    assert choose_bake(take, "same").chosen, "it is the present stream itself"
    other = take.bakes / "other"
    (take.bakes / "same").rename(other)
    note = json.loads((other / "bake.json").read_text())
    manifest = other / "stream" / "manifest.json"
    data = manifest.read_bytes()
    manifest.unlink()
    manifest.write_bytes(data + b"\n")
    del note["bake"]["digests"]["stream/manifest.json"]
    (other / "bake.json").write_text(json.dumps(note))
    with refuses("bakes.would_be_lost") as refused:
        choose_bake(take, "other")
    assert "'fine'" in str(refused.value)


@pytest.mark.parametrize(
    ("config", "code"), [("bake: [", "settings.not_yaml"), ("bake:\n  gone: 3\n", "settings.unknown")]
)
def test_a_broken_config_leaves_the_present_bake(take: Take, config: str, code: str) -> None:
    keep_bake(take, "fine")
    take.config.write_text(config)
    before = contents(take.root)
    with refuses(code, file=take.config):
        choose_bake(take, "fine")
    assert contents(take.root) == before


def test_settings_of_a_kept_bake_leave_a_valid_config(take: Take) -> None:
    keep_bake(take, "fine")
    path = take.bakes / "fine" / "bake.json"
    note = json.loads(path.read_text())
    note["bake"]["params"] |= {"bake.gone": 3, "bake.qp": 33}
    path.write_text(json.dumps(note))
    assert "bake.gone" in remarks(choose_bake(take, "fine"))[0]
    assert load_config(take.config).bake.qp == 33
    note["bake"]["params"]["bake.qp"] = "many"
    path.write_text(json.dumps(note))
    before = contents(take.root)
    with refuses("bakes.settings_refused", file=path):
        choose_bake(take, "fine")
    assert contents(take.root) == before
