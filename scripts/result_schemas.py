"""Writes the JSON schemas of a take's results to docs/: `python scripts/result_schemas.py`.

It does not write docs/stream.schema.json, the schema of the stream's manifest.
"""

from pathlib import Path

from pydantic import BaseModel

from v3studio.pipelines.takes.results.evaluation import Evaluation
from v3studio.pipelines.takes.results.records import StageRecord
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.json_types import JsonObject

DOCS = Path(__file__).resolve().parent.parent / "docs"
MODELS: dict[str, type[BaseModel]] = {
    "evaluation.schema.json": Evaluation,
    "calibration.schema.json": CalibrationReport,
    "record.schema.json": StageRecord,
}


def schema(model: type[BaseModel]) -> JsonObject:
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema()}


if __name__ == "__main__":
    from v3studio.studio.atomic_files import write_json

    for name, model in MODELS.items():
        write_json(DOCS / name, schema(model))
