"""Every setting of a run: validated before anything starts, documented where it is declared.

`load_config` reads a YAML file and command-line overrides; `describe` prints all settings with their documentation.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # imported on first use; see __init__.pyi
