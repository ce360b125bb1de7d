"""The stage bake with ladders: only what changed is baked again."""

import json

from studio.stream import StreamReader
from tests.support.streams import contents


def manifest_of(take):
    return json.loads((take / "stream" / "manifest.json").read_bytes())


def test_a_take_is_baked_as_a_ladder(here, copied):
    take = copied / "take"
    rungs = "[{qp: 20}, {qp: 34}, {qp: 30, splats: 0.5, sh_degree: 0, finetune_iterations: 10}]"
    here("bake", take, "--bake.ladder", rungs).ok()
    manifest = manifest_of(take)
    assert manifest["version"] == 4
    assert [one["id"] for one in manifest["renditions"]] == ["qp20", "qp34", "qp30-splats50-sh0"]
    best, coarse, phone = manifest["renditions"]
    assert best["psnr_to_trained"] > coarse["psnr_to_trained"] > 10
    assert phone["psnr_to_trained"] > 10
    assert phone["splats"] < best["splats"]
    assert [one["pruning"] for one in manifest["renditions"]] == ["none", "none", "fine-tuned"]
    ladder = contents(take / "stream")
    assert all(name == "manifest.json" or name.startswith("files/") for name in ladder)
    with StreamReader.open(take / "stream") as reader:
        reader.verify()
        assert len(list(reader.iterate())) == 5

    inodes = {name: (take / "stream" / name).stat().st_ino for name in ladder}
    tuned = {path: path.stat().st_mtime_ns for path in take.glob("train/*/offsets_*")}
    assert sorted(path.name for path in tuned) == ["offsets_splats50-sh0-10.safetensors"] * 2
    assert "up to date" in here("bake", take).ok().stdout.lower()
    here("bake", take, "--bake.ladder", rungs.replace("34", "36").replace("30", "32")).ok()
    assert {path: path.stat().st_mtime_ns for path in tuned} == tuned
    names = contents(take / "stream")
    kept = {name for name in names if inodes.get(name) == (take / "stream" / name).stat().st_ino}
    best = [group["renditions"][0] for group in manifest_of(take)["groups"]]
    assert {one[kind]["path"] for one in best for kind in ("side", "video")} <= kept
    assert len(names) <= 13

    here("evaluate", take).ok()
    figures = json.loads((take / "evaluation.json").read_bytes())
    with StreamReader.open(take / "stream") as reader:
        assert figures["summary"]["bytes_per_frame"] == round(reader.played_bytes / 5, 1)
