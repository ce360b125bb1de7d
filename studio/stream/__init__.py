"""The stream: Gaussians baked into videos with a manifest, and read back. Specified in `docs/STREAM.md`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # imported on first use; see __init__.pyi
