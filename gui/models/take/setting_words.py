"""The form in which settings are shown: labels, units, paths to choose, and which ones most people need."""

from collections.abc import Mapping

LABELS: Mapping[str, str] = {  # of settings whose name is not what people say
    "bake.attribute_qps": "QPs of attributes",
    "bake.b_frames": "B-frames",
    "bake.ladder": "renditions",
    "calibrate.frame_count": "number of frames",
    "calibrate.known": "use of known cameras",
    "capture.cameras": "cameras used",
    "capture.fps": "frame rate",
    "capture.held_out": "held-out cameras",
    "capture.rig": "camera file",
    "capture.root": "folder of the footage",
    "capture.scale": "scale of images",
    "capture.frames": "frames used",
    "evaluate.lpips": "LPIPS",
    "initialize.max_faces": "most faces",
    "initialize.points": "number of points",
    "initialize.resolution": "voxels per side",
    "run.gpus_per_group": "GPUs per group",
    "run.preview_seconds": "time between previews",
    "train.alpha_weight": "weight of the mask",
    "train.densify_max_splats": "densify up to",
    "train.dssim_weight": "weight of D-SSIM",
    "train.finetune_iterations": "fine-tuning iterations",
    "train.finetune_means": "fine-tune means",
    "train.joint_iterations": "joint iterations per frame",
    "train.max_splats": "most splats",
    "train.mlp_layers": "MLP layers",
    "train.mlp_width": "MLP width",
    "train.opacity_reg": "opacity regularization",
    "train.prune_finetune_iterations": "iterations after pruning",
    "train.rates.sh_dc": "rates: SH, mean color",
    "train.rates.sh_rest": "rates: SH, others",
    "train.scale_reg": "scale regularization",
    "train.sh_degree": "SH degree",
    "train.sh_degree_every": "iterations per SH degree",
}

UNITS: Mapping[str, str] = {  # shown in parentheses after the name
    "calibrate.board.marker": "m",
    "calibrate.board.square": "m",
    "capture.audio_offset": "s",
    "capture.fps": "fps",
    "evaluate.crop_padding": "px",
    "run.memory_per_group": "GB",
    "run.preview_seconds": "s",
    "train.group_size": "frames",
}

FOLDERS = frozenset({"capture.root"})  # settings that are a folder, to be chosen in a dialog

FILES = frozenset({"calibrate.known_cameras", "calibrate.tie_points", "capture.audio", "capture.rig"})
"""Settings that are a file."""

TEMPLATES = frozenset({"capture.clean_plates", "capture.images", "capture.mask_files", "evaluate.exact_masks"})
"""Settings that are paths with placeholders, which are long."""

BASIC = frozenset(
    {
        "bake.ladder", "bake.quality",
        "calibrate.board.columns", "calibrate.board.kind", "calibrate.board.rows", "calibrate.board.square",
        "calibrate.board_images", "calibrate.camera_model", "calibrate.floor", "calibrate.frame_count",
        "calibrate.known_distance", "calibrate.tie_points", "capture.audio", "capture.cameras",
        "capture.held_out", "capture.images", "capture.mask_files", "capture.mask_sensitivity",
        "capture.masks", "capture.rig", "capture.root", "capture.scale", "capture.frames",
        "evaluate.lpips", "initialize.points", "initialize.resolution",
        "run.groups_at_once", "train.alpha_weight", "train.dropout",
        "train.finetune_iterations", "train.group_size", "train.keyframe_iterations",
        "train.max_splats", "train.motion_iterations", "train.scale_reg", "train.sh_degree",
    }
)  # fmt: skip
"""Settings that are shown unless all are wanted."""
