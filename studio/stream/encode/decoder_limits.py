"""The limits of common hardware decoders of H.264, and renditions that go beyond them."""

from v3studio.studio.errors import Message
from v3studio.studio.stream.manifest import GroupEntry

MAX_SIDE = 4096  # pixels; 4096x2304 is the largest image of phones in landscape, 2304x4096 in portrait
MAX_MACROBLOCKS = 36_864  # MaxFS of level 5.1 (ITU-T H.264, table A-1): macroblocks of 16x16 pixels in an image
MAX_MACROBLOCK_RATE = 983_040  # MaxMBPS of level 5.1: macroblocks per second


def beyond_hardware(group: GroupEntry, fps: float) -> list[Message]:
    """One warning for each rendition that hardware decoders of H.264 may refuse when it plays at `fps`."""
    messages = []
    for rendition in group.renditions:
        width, height = rendition.size
        macroblocks = (width // 16) * (height // 16)
        problem = fix = ""
        if max(width, height) > MAX_SIDE or macroblocks > MAX_MACROBLOCKS:
            problem = f"its pictures of {width}x{height} are larger than level 5.1 or {MAX_SIDE} pixels a side"
            fix = "Train fewer splats or a lower SH degree, or add a rung with fewer splats."
        elif macroblocks * fps > MAX_MACROBLOCK_RATE:
            problem = f"{width}x{height} at {fps:g} frames per second exceeds level 5.1"
            fix = "Train fewer splats or a lower SH degree, or add a rung with fewer splats."
        elif rendition.pruning != "none" and rendition.video.qp == 0:
            problem = "QP 0 (lossless) has the profile High 4:4:4 Predictive"
            fix = "Raise the rung's qp to 1."
        if problem:
            problem = f"hardware decoders may refuse rendition {rendition.id} of group {group.index}: {problem}"
            fields = {"rendition": rendition.id, "group": group.index, "size": [width, height], "fps": fps}
            messages.append(Message("bake.beyond_hardware", problem, fix=fix, fields=fields))
    return messages
