"""The version of the installed package."""


def program_version() -> str:
    """Version of the installed package; "unknown" if it is not installed."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("v3studio")
    except PackageNotFoundError:
        return "unknown"
