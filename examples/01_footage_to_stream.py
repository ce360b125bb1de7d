"""Run all stages of a take: from multi-camera videos to a measured stream.

    python examples/01_footage_to_stream.py --take my-take

The settings below are chosen for speed, not quality: two frames of eight cameras at a quarter of the size. For good
results, see `sample_configs/quickstart.yaml`. Run the script again to resume after an interruption; if all stages are
done, it does nothing.
"""

import argparse
import tempfile
from pathlib import Path

import v3studio as v3

SAMPLE = Path(__file__).resolve().parents[1] / "sample_captures" / "dance16"
QUICK = {
    "capture.root": str(SAMPLE),
    "capture.masks": "clean_plate",
    "capture.clean_plates": "clean_plates/{camera}.png",
    "evaluate.exact_masks": "mattes/{camera}.mkv",
    "capture.cameras": [f"cam{number:02d}" for number in range(1, 16, 2)],
    "capture.held_out": ["cam05"],
    "capture.frames": ":2",
    "capture.scale": 0.25,
    "initialize.points": 2000,
    "initialize.resolution": 64,
    "train.keyframe_iterations": 60,
    "train.densify_from": 20,
    "train.densify_until": 40,
    "train.prune_finetune_iterations": 20,
    "train.motion_iterations": 20,
    "train.finetune_iterations": 20,
}


def report(event: v3.Event) -> None:
    """Receives all events of the run: progress, figures, warnings."""
    if isinstance(event, v3.StageFinished):
        print(f"{event.stage}: {event.seconds:.1f} s")
    elif isinstance(event, v3.Warned):
        print(f"warning: {event.message}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--take", type=Path, help="folder of the take (default: a temporary folder)")
    folder = parser.parse_args().take or Path(tempfile.mkdtemp()) / "take"

    take = v3.Take.create(folder)
    figures = v3.run(take, QUICK, report)

    for name, stage in v3.status(take, QUICK).items():
        print(f"{name}: {stage.state}, {figures[name]}")
    evaluation = v3.read_evaluation(take.evaluation)
    print(f"stream: {take.stream}")

    # the same figures for one frame: trained splats against the footage of the held-out camera
    config = v3.load_config(take.config)
    rig, masks = v3.read_rig(take.rig), config.evaluate.exact_masks
    footage = v3.open_footage(config.capture, rig, evaluation_masks=masks)
    frame = footage.frames[0]
    measured = v3.evaluate(v3.trained_video(take).read(0), footage, frame)
    print(f"frame {frame}: {measured}")
    assert abs(measured["cam05"]["psnr"] - evaluation.frames[0].psnr_trained) < 0.05


if __name__ == "__main__":
    main()
