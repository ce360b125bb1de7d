"""The command-line reference: every command's usage, arguments and notes, from its argparse parser."""

import argparse
import contextlib
import io
import os

from generate.markdown import code, escaped, table

INTRODUCTION = """# Commands

All commands take `--help`. Commands with the option `--set` also take any [setting](settings.md) as `--SECTION.NAME
VALUE`. All but `open` take `--json`, with which they print [events](events.md), and `--verbose`, which says on standard
error what they are waiting for: when stages, child processes and calls of libraries begin and end.

Exit codes: 0 for success, 1 for a failure or bad input, 2 for wrong usage, 130 if stopped. A failure is one sentence on
standard error.
"""
_WIDTH = "100"  # argparse wraps usage lines at the terminal's width


def commands_page() -> str:
    """Markdown of `v3studio` with all its commands, and of `v3studio-gui`."""
    from v3studio.pipelines.cli import make_parser

    os.environ["COLUMNS"] = _WIDTH
    parser, commands = make_parser()
    (group,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    summaries = {action.dest: action.help or "" for action in group._choices_actions}
    rows = [(f"[`{name}`](#{name.replace(' ', '-')})", escaped(text)) for name, text in summaries.items()]
    lines = [INTRODUCTION, *table(("Command", "What it does"), *rows), ""]
    for name, command in commands.items():
        lines += _command(name, command, summaries[name])
    lines += ["## v3studio-gui", "", "```text", _gui_help(), "```", ""]
    return "\n".join(lines)


def _command(name: str, parser: argparse.ArgumentParser, summary: str, level: int = 2) -> list[str]:
    description = parser.description or summary
    usage = parser.format_usage().removeprefix("usage: ").rstrip().replace("\n       ", "\n")
    lines = [
        f"{'#' * level} {name} {{ #{name.replace(' ', '-')} }}",
        "",
        escaped(_sentence(description)),
        "",
        "```text",
        usage,
        "```",
        "",
    ]
    formatter = parser._get_formatter()
    rows: list[tuple[str, str]] = []
    nested: list[str] = []
    for action in parser._actions:
        if action.help is argparse.SUPPRESS or isinstance(action, argparse._HelpAction):
            continue
        if isinstance(action, argparse._SubParsersAction):
            nested += [
                part
                for kind, child in action.choices.items()
                for part in _command(f"{name} {kind}", child, child.description or "", level + 1)
            ]
            continue
        said = formatter._expand_help(action) if action.help else ""
        rows.append((_invocation(action), escaped(said)))
    if rows:
        lines += [*table(("Argument", "Meaning"), *rows), ""]
    if parser.epilog and not parser.epilog.startswith("settings:"):
        lines += ["```text", parser.epilog.rstrip(), "```", ""]
    return lines + nested


def _invocation(action: argparse.Action) -> str:
    value = " ".join(action.metavar) if isinstance(action.metavar, tuple) else action.metavar
    value = value or ("{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper())
    if not action.option_strings:
        return code(value)
    if action.nargs == 0:
        return ", ".join(map(code, action.option_strings))
    return ", ".join(code(f"{option} {value}") for option in action.option_strings)


def _sentence(text: str) -> str:
    text = " ".join(text.split())
    return text and text[0].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def _gui_help() -> str:
    from v3studio.gui.app import main

    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        main(["--help"])
    return output.getvalue().rstrip()
