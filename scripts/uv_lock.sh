#!/bin/sh
# `uv lock` against the public default index, whatever indexes this machine is set up with: a local path or a company's
# mirror in uv.lock would be of no use to anybody else. Arguments go to `uv lock` (--check).
set -eu
cd "$(dirname "$0")/.."

uv=$(cat .venv/uv.path 2>/dev/null) || { echo "uv.lock: skipped, there is no uv in this set-up"; exit 0; }
exec env -u UV_DEFAULT_INDEX -u UV_INDEX -u UV_INDEX_URL -u UV_EXTRA_INDEX_URL -u UV_FIND_LINKS -u UV_NO_INDEX \
    -u UV_FROZEN -u UV_LOCKED "$uv" lock --no-config "$@"
