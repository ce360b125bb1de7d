#!/usr/bin/env bash
# Prints the Python to use: $PYTHON if set, else the first of these that is 3.11 or newer.
set -euo pipefail
for candidate in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.12 python3.11 python3.14; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then
        command -v "$candidate"
        exit 0
    fi
done
echo "V3 Studio needs Python 3.11 or newer and found none; install python3.11 or set PYTHON=/path/to/python3." >&2
exit 1
