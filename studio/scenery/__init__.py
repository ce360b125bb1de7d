"""The set behind a performer: depths in images of it, and its splats."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # imported on first use; see __init__.pyi
