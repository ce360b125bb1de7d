from v3studio.gui.models.take.inspector import Block, figures_height


def test_a_long_name_takes_another_line_instead_of_its_value() -> None:
    name, value = "uncut PSNR picture after a color fit", "29.30 / 29.21"
    long, short = (Block("Quality", [(words, value)]) for words in (name, "SSIM"))
    two = Block("Quality", [("SSIM", value), ("SSIM", value)])
    assert figures_height([long], 270, 16.0) == figures_height([two], 270, 16.0) > figures_height([short], 270, 16.0)
