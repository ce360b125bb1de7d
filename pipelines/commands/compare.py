"""`v3studio compare`: a table and images of several takes, measured alike."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command, add_frames, add_overwrite, invalid_option
from v3studio.pipelines.outputs import check_output
from v3studio.pipelines.reports.terminal import console, escaped, table_of
from v3studio.studio.comparison.protocols import PROTOCOLS
from v3studio.studio.counts import counted

if TYPE_CHECKING:
    from v3studio.pipelines.comparison.results import Comparison

_NOTE = """protocols:
{protocols}

All takes are compared with the same images and masks: those of the first take's settings, or of --footage. Each is
rendered with its own calibration. Figures of different protocols cannot be compared with each other.

The same command resumes an interrupted comparison. Its finished frames are in DIR/.comparing until then.
"""


def register(commands: Any) -> None:
    parser = add_command(
        commands,
        "compare",
        "measure takes by one protocol and show them side by side",
        _compare,
        epilog=_NOTE.format(
            protocols="\n".join(f"  {protocol.name:<8}{protocol.title}" for protocol in PROTOCOLS.values())
        ),
    )
    parser.add_argument("takes", type=Path, nargs="+", metavar="TAKE", help="folders of takes with a stream")
    parser.add_argument("--protocol", choices=list(PROTOCOLS), default="box", help="see below (default: %(default)s)")
    parser.add_argument("--cameras", default="", metavar="A,B", help="cameras to measure instead of the protocol's")
    parser.add_argument(
        "--footage", type=Path, metavar="TAKE", help="take whose images and masks to compare with (default: the first)"
    )
    add_frames(parser, "measure", "; with a step, flicker is not measured")
    parser.add_argument("--lpips", choices=("alex", "vgg"), help="also compute LPIPS, as the setting evaluate.lpips")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("comparison"),
        metavar="DIR",
        help="folder for comparison.json and images (default: %(default)s)",
    )
    add_overwrite(parser)
    parser.add_argument(
        "--images", type=int, default=2, metavar="N", help="number of images per camera (default: %(default)s)"
    )


def _compare(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.commands.common.working import working
    from v3studio.pipelines.comparison.compare import compare
    from v3studio.pipelines.comparison.results import FOLDER, RESULTS
    from v3studio.pipelines.stages.inputs import choose_device

    if arguments.images < 0:
        raise invalid_option("--images", f"--images {arguments.images} is below 0", "Example: --images 2.")
    # one that was interrupted is resumed
    unfinished = not (arguments.out / RESULTS).exists()
    ours = arguments.out / RESULTS, arguments.out / FOLDER
    check_output(arguments.out, arguments.overwrite or unfinished, lambda _: any(path.exists() for path in ours))
    device = choose_device("auto")
    lpips = None
    if arguments.lpips:
        from v3studio.studio.perceptual import Lpips

        lpips = Lpips(arguments.lpips, device)
    with working("compare", arguments) as progress:
        result = compare(
            arguments.takes,
            arguments.out,
            PROTOCOLS[arguments.protocol],
            cameras=[name for name in arguments.cameras.split(",") if name],
            footage=arguments.footage,
            part=arguments.frames,
            images=arguments.images,
            lpips=lpips,
            device=device,
            progress=progress,
        )
    arguments.result = {"path": str(arguments.out.absolute()), **result.to_json()}
    if not arguments.json:
        _print(result, arguments.out)


def _print(result: Comparison, out: Path) -> None:
    from v3studio.studio.comparison import FLICKER, METRICS

    protocol = result.protocol
    metrics = [metric for metric in METRICS if metric.name in result.takes[0].measures]
    titles = [metric.title for metric in metrics]
    table = table_of("take", *titles, FLICKER.title, "at borders", "KB/frame", "bytes", left=(0,))
    for take in result.takes:
        table.add_row(
            escaped(take.name) + ("*" if take.trained_on else ""),
            *(metric.text(take.measures.get(metric.name), unit=False) for metric in metrics),
            FLICKER.text(take.flicker, unit=False),
            FLICKER.text(take.flicker_at_group_borders, unit=False),
            f"{take.bytes_per_frame / 1000:.1f}",
            f"{take.total_bytes:,}",
        )
    screen = console()
    screen.print(table)
    sizes = ", ".join(f"{name} {width}x{height}" for name, (width, height) in protocol.resolution.items())
    masks = "exact masks" if protocol.exact_masks else "the take's own masks"
    screen.print(
        f"{protocol.name}: {sizes}; {counted(len(protocol.frames), 'frame')}; crop: {protocol.crop}; background "
        f"{protocol.background}; {masks} of {protocol.footage}.\n"
        "PSNR in dB as filmed, and after a 3x4 color fit of each view. Flicker: change of the residual from frame to "
        "frame, in levels of 255, and the same at group borders.",
        style="dim",
        markup=False,
    )
    for take in result.takes:
        if take.trained_on:
            screen.print(
                f"* {take.name} was trained on {', '.join(take.trained_on)}: not new views.", style="dim", markup=False
            )
    screen.print(f"results and images: {out}", markup=False, soft_wrap=True)
