#!/bin/sh
# Runs a command of .venv with the libraries of the group `mf4` besides, which stay out of .venv: python-can imports them
# wherever they are installed. uv brings them in the versions of uv.lock, or pip does where there is no uv.
set -eu
cd "$(dirname "$0")/.."

folder=.cache/mf4
stamp=$folder/.fits
if ! cmp -s uv.lock "$stamp"; then
    rm -rf "$folder"
    mkdir -p "$folder"
    if uv=$(cat .venv/uv.path 2>/dev/null) && [ -n "$uv" ]; then
        "$uv" export --quiet --frozen --no-hashes --no-emit-workspace --only-group mf4 > "$folder/requirements.txt"
        "$uv" pip install --quiet --python .venv/bin/python --target "$folder" --requirements "$folder/requirements.txt"
    else
        .venv/bin/python -m pip install --quiet --target "$folder" "asammdf>=8"
    fi
    cp uv.lock "$stamp"
fi
PYTHONPATH=$PWD/$folder exec "$@"
