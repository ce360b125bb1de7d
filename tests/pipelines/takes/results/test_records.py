import errno
import os
from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.records import StageRecord, read_record, result_of
from v3studio.pipelines.takes.take import Take


@pytest.mark.parametrize("number", [errno.ESTALE, errno.EMFILE, errno.EIO, errno.ENOMEM])
def test_a_read_that_fails_once_is_not_kept(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Take.create(tmp_path)
    write_model(take.record("train"), StageRecord(stage="train", params={}, result="abc"))

    def fails(path: Path, *_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", fails)
        for read in (result_of, read_record):
            with refuses("take.cannot_read", file=take.record("train")):
                read(take, "train")
    assert result_of(take, "train") == "abc"


def test_a_damaged_record_is_none(tmp_path: Path) -> None:
    take = Take.create(tmp_path)
    take.record("train").parent.mkdir(parents=True)
    take.record("train").write_text("{")
    assert (read_record(take, "train"), result_of(take, "train"), result_of(take, "bake")) == (None, None, None)
