import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.streams import contents
from tests.support.tiny_capture import Here
from v3studio.pipelines.config import load_config
from v3studio.pipelines.review.take_review import TakeReview
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.authored.edits import change_edits, read_edits
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.results.point_files import read_points
from v3studio.pipelines.takes.results.videos import decoded_video, trained_video
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits.edit_list import Region
from v3studio.studio.formats.rigid_motion import placed
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.stream import StreamMetadata, StreamReader


@pytest.fixture
def take(copied: Path) -> Path:
    return copied / "take"


def states(here: Here, take: Path) -> dict[str, dict[str, str]]:
    return here("status", take, "--json").ok().result["stages"]


def test_a_take_is_trimmed_cropped_and_placed_and_as_before_when_that_is_undone(here: Here, take: Path) -> None:
    before = contents(take / "stream")
    measured = json.loads((take / "evaluation.json").read_text())
    rows = {row["index"]: row for row in measured["frames"]}

    here("edit", "trim", take, "1:4").ok()
    here("edit", "world", take, "--up", 0, 0, 1, "--origin", 0, 0, "-0.5", "--scale", 100).ok()
    # above the origin there is less than half of the ball
    here("edit", "crop", take, "--min", -100, 50, -100, "--max", 100, 200, 100).ok()
    stages = states(here, take)
    assert {stages[name]["state"] for name in ("calibrate", "initialize", "train")} == {"done"}
    assert stages["bake"]["state"] != "done"
    for words in ("the trim was set", "the crop box was set", "the placement of the world was set"):
        assert words in stages["bake"]["reason"]
    here("run", take).ok()

    opened, edits = Take.open(take), read_edits(take / "edits.json")
    trained = [read_frame(opened.trained_frame(*place)) for place in ((0, 1), (0, 2), (1, 3))]
    with StreamReader.open(take / "stream") as reader:
        assert (reader.frame_count, reader.index.starts) == (3, (0, 2))
        video, own = decoded_video(reader), trained_video(take)
        assert own.frame_count == 3
        place = StreamMetadata.from_json(reader.manifest.metadata).capture
        assert place.first_frame == 1
        assert np.allclose(video.up, [0, 1, 0])
        for index, whole in enumerate(trained):
            decoded, edited = video.read(index), own.read(index)
            assert 0 < len(decoded) == len(edited) < len(whole)
            assert float(edited.means[:, 1].median()) > 50
            # what is kept is where it was, seen by the same camera
            apart = placed(whole, edits.similarity).means[:, None] - edited.means
            kept = apart.norm(dim=2).min(dim=1).values < 1e-4
            assert int(kept.sum()) == len(edited)
            pictures = [rasterize(splats, video.view).image for splats in (edited, decoded)]
            assert float((pictures[0] - pictures[1]).abs().mean()) < 0.02
    again = json.loads((take / "evaluation.json").read_text())
    assert [row["index"] for row in again["frames"]] == again["protocol"]["frames"] == [1, 2, 3]
    played = here("play", take, "--frames", "2:4", "--json").result["frames"]
    assert [(row["frame"], row["group"]) for row in played] == [(2, 0), (3, 1)]
    review = TakeReview(opened).data()
    assert review.frame_count == 3
    assert review.quality.metrics[0].decoded == tuple(row["psnr_decoded"] for row in again["frames"])

    here("edit", "remove", take, "crop").ok()
    here("run", take).ok()
    again = json.loads((take / "evaluation.json").read_text())
    for row in again["frames"]:  # placing and trimming leave the picture as it was
        assert row["psnr_trained"] == pytest.approx(rows[row["index"]]["psnr_trained"], abs=0.02)
        assert row["psnr_decoded"] == pytest.approx(rows[row["index"]]["psnr_decoded"], abs=0.3)

    here("edit", "remove", take, "all").ok()
    assert here("edit", "list", take).ok().stdout.startswith("no edits")
    here("bake", take).ok()
    assert contents(take / "stream") == before
    here("edit", "undo", take).ok()
    assert "frames 1 to 3" in here("edit", "list", take).ok().stdout


def test_a_box_for_training_makes_training_stale_and_masks_what_it_sees(here: Here, take: Path) -> None:
    here("edit", "crop", take, "--min", "-1", "-1", 0, "--max", 1, 1, 1, "--training").ok()
    stages = states(here, take)
    assert stages["calibrate"]["state"] == "done"
    assert "the crop box was set" in stages["initialize"]["reason"]
    assert stages["train"]["state"] != "done"
    whole = read_points_of(take)
    assert whole[:, 2].min() < -0.4
    here("initialize", take).ok()
    assert read_points_of(take)[:, 2].min() >= 0
    here("edit", "undo", take).ok()
    here("initialize", take).ok()
    assert np.array_equal(read_points_of(take), whole)


def test_a_click_on_a_mask_makes_training_stale_but_not_the_cameras(here: Here, take: Path) -> None:
    def mask() -> np.ndarray:
        opened = Take.open(take)
        return Inputs(opened, load_config(opened.config)).calibrated_footage.raw_mask("cam1", 0)

    before = mask()
    place = np.argwhere(before == 0)[0][::-1]
    here("edit", "mask", take, "--camera", "cam1", "--frame", 0, "--performer", *place).ok()
    assert mask()[place[1], place[0]] == 255
    assert "masks 1" in here("edit", "list", take).ok().stdout
    stages = states(here, take)
    assert stages["calibrate"]["state"] == "done"
    assert stages["initialize"]["reason"] == "the clicks on masks were set"
    assert "the clicks on masks were set" in stages["set"]["reason"]
    assert stages["train"]["state"] != "done"
    here("edit", "undo", take).ok()
    np.testing.assert_array_equal(mask(), before)


def test_a_detail_is_trained_with_more_splats_and_as_before_when_that_is_undone(here: Here, take: Path) -> None:
    opened = Take.open(take)
    files = [opened.trained_frame(*place) for place in ((0, 0), (0, 1), (1, 3))]
    before, initialized = [path.read_bytes() for path in files], states(here, take)["initialize"]
    here("edit", "world", take, "--scale", 100).ok()
    here("edit", "detail", take, "--frame", 2, "--at", 0, 0, 40, "--radius", 30, "--weight", 20).ok()
    (mark,) = read_edits(take / "edits.json").details
    assert mark.radius == pytest.approx(0.3)
    assert mark.at(2) == pytest.approx([0, 0, 0.4])
    assert [frame for frame, _ in mark.path] == [0, 2, 3, 4], "borders of the groups"
    assert "details 1" in here("edit", "list", take).ok().stdout
    stages = states(here, take)
    assert stages["initialize"] == initialized
    assert stages["train"]["reason"] == "the marked details were set"
    assert "details" not in stages["bake"]["reason"]
    here("train", take).ok()

    def share(data_of: Path) -> float:
        """The share of splats near the mark."""
        means = read_frame(data_of).means.numpy()
        return float((np.linalg.norm(means - mark.at(0), axis=1) < mark.radius).mean())

    more = share(files[0])
    here("edit", "undo", take).ok()
    here("train", take).ok()
    assert [path.read_bytes() for path in files] == before
    assert more > 1.1 * share(files[0])


def read_points_of(take: Path) -> np.ndarray:
    return read_points(Take.open(take).initialize_group(0) / "points.ply")[0]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("trim", "0:6"), "the take has no frame 5. It has frames 0 to 4."),
        (("trim", "0:4:2"), "no step"),
        (("crop", "--min", 1, 0, 0, "--max", 0, 1, 1), "--min 1 0 0 is not below --max 0 1 1"),
        (("floaters",), "opacity, splats or share must be set"),
        (("floaters", "--share", 2), "floaters.share"),
        (("world", "--from", 0, 0, 0, "--distance", 1), "--from, --to and --distance are used together"),
        (("world", "--scale", 0), "world.scale"),
        (("mask", "--camera", "cam7", "--frame", 0, "--performer", 1, 1), "no camera 'cam7'"),
        (("mask", "--camera", "cam0", "--frame", 7, "--performer", 1, 1), "the take has no frame 7"),
        (("mask", "--camera", "cam0", "--frame", 0), "neither --performer nor --background"),
        (("remove", "box"), "there is no edit named 'box'"),
        (("remove", "regions", 1), "there is no region 1"),
        (("remove", "detail", 1), "there is no detail 1"),
        (("detail", "--at", 9, 9, 9, "--radius", 1), "there are no splats within 1 of (9, 9, 9) in this frame"),
        (("detail", "--at", 0, 0, 0, "--radius", 1, "--frame", 5), "frame 5 is not trained. The trained frames are 0"),
        (("detail", "--at", 0, 0, 0, "--radius", 1, "--weight", 101), "weight = 101.0 must be at most 100"),
        (("detail", "--at", 0, 0, 0, "--radius", 0), "radius = 0.0 must be above 0"),
        (("detail", "--at", 0, 0, 0, "--radius", 1, "--weight", "0.5"), "weight = 0.5 must be at least 1"),
        (("undo",), "there is no edit to undo. See the edits that there are with `v3studio edit list TAKE`."),
    ],
)
def test_bad_input_changes_nothing(here: Here, finished: Path, words: tuple[str | int, ...], sentence: str) -> None:
    unknown = words[0] == "undo" or words[-1] == 5 or 9 in words  # not in this take
    result = here("edit", words[0], finished / "take", *words[1:]).fails(sentence, code=1 if unknown else 2)
    assert result.stderr.startswith("error: ")
    assert not (finished / "take" / "edits.json").exists()


def test_floaters_ground_and_regions(here: Here, take: Path) -> None:
    here("edit", "floaters", take, "--opacity", "0.05", "--share", "0.02").ok()
    here("edit", "ground", take, "-0.2").ok()
    edits = read_edits(take / "edits.json")
    assert edits.ground is not None
    camera = next(iter(read_rig(take / "calibrate" / "rig.json")))
    region = {
        "view": {"width": 64, "height": 48, "K": camera.K.tolist(), "world_to_camera": camera.world_to_camera.tolist()},
        "outline": [[0, 0], [64, 0], [64, 24], [0, 24]],
    }
    change_edits(take / "edits.json", edits.with_(regions=(Region.model_validate(region),)), "region", edits)
    counted = here("edit", "count", take).ok().stdout.splitlines()
    assert len(counted) == 2
    assert all("ground" in line and "regions" in line for line in counted)
    whole = len(read_frame(Take.open(take).trained_frame(0, 0)))
    left = len(trained_video(take).read(0))
    assert f"{whole - left:,} of {whole:,} splats removed" in counted[0]
    here("edit", "ground", take, "10").ok()
    here("bake", take).fails("the edits remove all splats of group 0")
