from .card import Card as Card
from .card import Check as Check
from .card import Measured as Measured
from .card import measure as measure
from .picture import draw as draw
