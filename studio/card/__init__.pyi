from .card import Measured as Measured
from .card import measure as measure
from .grades import Card as Card
from .grades import Check as Check
from .picture import draw as draw
from .sample import Sample as Sample
