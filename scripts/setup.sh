#!/bin/sh
# Makes .venv in the checkout: the five packages, editable, and the development tools, in the versions of uv.lock.
#
# uv does it where it can be had: the one on PATH, else one installed privately into .cache/uv. Otherwise (or with NO_UV=1)
# `python -m venv` and pip do it. Leaves the path of uv in .venv/uv.path, for the check of the lock file and of the wheels,
# and a stamp that names the checkout and the contents of the files it was made from.
set -eu
cd "$(dirname "$0")/.."

say() { echo "setup: $*" >&2; }
die() { say "$*"; exit 1; }

runs() { "$@" >/dev/null 2>&1; }

# The real interpreter, not a shim or the python of an active .venv (which may be about to be replaced).
interpreter() {
    "$1" -c 'import os, sys
if sys.version_info < (3, 11): sys.exit(1)
print(os.path.abspath(getattr(sys, "_base_executable", None) or sys.executable))' 2>/dev/null
}

find_python() {
    wanted=${PYTHON:-python3}
    interpreter "$wanted" && return
    if [ "$wanted" = python3 ]; then
        for name in python3.14 python3.13 python3.12 python3.11 python; do
            interpreter "$name" && return
        done
    fi
    found=$("$wanted" --version 2>&1) || found="it does not run"
    die "$wanted: Python 3.11 or newer is needed ($found); name another one with: make PYTHON=/path/to/python3.12"
}

find_uv() {
    private=.cache/uv/bin/uv
    if runs uv --version; then command -v uv; return; fi
    if ! runs "$private" --version; then
        say "bringing uv along (into .cache/uv; NO_UV=1 does without)"
        why=$(private_uv 2>&1) || say "uv cannot be had: $(printf '%s\n' "$why" | tail -n 1)"
    fi
    if runs "$private" --version; then echo "$PWD/$private"; fi
}

private_uv() {
    rm -rf .cache/uv
    "$python" -m venv .cache/uv && .cache/uv/bin/python -m pip install --retries 1 uv && return
    rm -rf .cache/uv
    "$python" -m pip install --retries 1 --target .cache/uv uv
}

with_uv() {
    UV_PROJECT_ENVIRONMENT="$PWD/.venv" "$uv" sync --frozen --all-packages --python "$python" --no-python-downloads &&
        echo "$uv" > .venv/uv.path || return 1
    runs scripts/uv_lock.sh --check --offline || say "uv.lock does not fit the pyproject.toml files: run make lock"
}

with_pip() {
    say "using venv and pip"
    problem=$("$python" -m venv --clear .venv 2>&1) || {
        rm -rf .venv
        echo "$problem" >&2
        die "$python cannot make a virtual environment, and uv is not there to do it (or NO_UV is set):" \
            "install Python's venv module (Debian, Ubuntu: apt install python3-venv) or uv"
    }
    .venv/bin/python scripts/locked.py constraints > .venv/constraints.txt
    .venv/bin/python scripts/locked.py dev > .venv/dev.txt
    .venv/bin/python -m pip install --quiet --retries 2 -c .venv/constraints.txt -r .venv/dev.txt \
        -e ./protocol -e ./emulator -e ./controller -e ./tui -e . ||
        die "pip could not install the packages (above)"
}

export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore PIP_USER=0
python=$(find_python)
stamp=.venv/.ready${NO_UV:+-without-uv}
wanted=$(printf '%s\n' "$PWD"; cat pyproject.toml ./*/pyproject.toml uv.lock scripts/setup.sh | cksum)

if runs .venv/bin/python --version; then
    # A new time stamp on the same contents (another branch and back) needs nothing.
    if [ "$(cat "$stamp" 2>/dev/null)" = "$wanted" ]; then touch "$stamp"; exit 0; fi
    # Scripts in an environment carry its absolute path: one made elsewhere cannot be mended.
    for old in .venv/.ready*; do
        if [ -f "$old" ] && [ "$(head -n 1 "$old")" != "$PWD" ]; then rm -rf .venv; fi
    done
else
    rm -rf .venv
fi
# What worked stays if uv fails now (a changed pyproject.toml without a network); its stamp, being older, asks again.
worked=
[ ! -f "$stamp" ] || worked=yes
for old in .venv/.ready*; do
    [ "$old" = "$stamp" ] || rm -f "$old"
done
rm -f .venv/uv.path

uv=
[ -n "${NO_UV:-}" ] || uv=$(find_uv)
if [ -z "$uv" ]; then
    with_pip
elif ! with_uv; then
    [ -z "$worked" ] || die "uv failed (above); .venv is as it was"
    say "uv failed (above)"
    with_pip
fi
printf '%s\n' "$wanted" > "$stamp"
