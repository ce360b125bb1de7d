from .config import Config as Config
from .description import describe as describe
from .loading import dump_config as dump_config
from .loading import load_config as load_config
from .loading import parse_override as parse_override
