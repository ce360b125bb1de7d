"""Review in a browser: a take's quality, footage and marks, served beside its stream."""

from pipelines.review.api import FOLDER, review_routes
from pipelines.review.take_review import TakeReview

__all__ = ["FOLDER", "TakeReview", "review_routes"]
