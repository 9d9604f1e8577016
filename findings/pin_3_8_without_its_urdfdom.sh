#!/usr/bin/env bash
# pin 3.8.0 asks for cmeel-urdfdom >= 4, and pip brings 6.0.0, whose libraries have other names than those against which
# Pinocchio is linked: it does not load.  With cmeel-urdfdom 4.0.1 and cmeel-tinyxml2 10.0.0, as placo 0.10.2 asks, it does.
# Seen on Linux x86-64 with Python 3.11:
#   ImportError: liburdfdom_sensor.so.4.0: cannot open shared object file: No such file or directory
# Exits with 1 if this has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/env"
load() { "$work/env/bin/python" -c 'import pinocchio; print("loads:", pinocchio.__version__)' 2>&1 | tail -n 1; }

"$work/env/bin/pip" install -q pin==3.8.0 cmeel-urdfdom==6.0.0 cmeel-tinyxml2==11.0.0
with_newest=$(load) || true
"$work/env/bin/pip" install -q cmeel-urdfdom==4.0.1 cmeel-tinyxml2==10.0.0
with_its_own=$(load) || true
printf 'urdfdom 6.0.0: %s\nurdfdom 4.0.1: %s\n' "$with_newest" "$with_its_own"
[[ $with_newest == *"ImportError: liburdfdom"* && $with_its_own == "loads: 3.8.0" ]]
