#!/usr/bin/env bash
# Prints the Python to use: $PYTHON if set, otherwise the first of the candidates below that is 3.11 or newer.
set -euo pipefail
new_enough='import sys; sys.exit(sys.version_info < (3, 11))'
if [ -n "${PYTHON:-}" ]; then
    if ! command -v "$PYTHON" >/dev/null; then
        echo "PYTHON is '$PYTHON', which is not a program; set it to Python 3.11 or newer, or unset it." >&2
    elif ! version=$("$PYTHON" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null); then
        echo "PYTHON is '$PYTHON', which does not run as Python; set it to Python 3.11 or newer, or unset it." >&2
    elif ! "$PYTHON" -c "$new_enough"; then
        echo "PYTHON is '$PYTHON', which is Python $version; V3 Studio needs 3.11 or newer." >&2
    else
        command -v "$PYTHON"
        exit 0
    fi
    exit 1
fi
for candidate in python3 python3.13 python3.12 python3.11 python3.14; do
    if "$candidate" -c "$new_enough" >/dev/null 2>&1; then
        command -v "$candidate"
        exit 0
    fi
done
echo "V3 Studio needs Python 3.11 or newer and found none; install python3.11 or set PYTHON=/path/to/python3." >&2
exit 1
