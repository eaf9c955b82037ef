"""Coverage-guided fuzzing: `make fuzz` drives the targets of tests/fuzz with atheris (libFuzzer), one process each.

New inputs are kept below .cache/fuzz and start the next run. An input that raises anything unexpected ends the
run with its bytes in .cache/fuzz/TARGET/crash-…, and exit status 1.
"""

import argparse
import importlib
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / ".cache" / "fuzz"
INPUTS = 10_000_000
LONGEST_INPUT = 512
INSTRUMENTED = ["canarm_protocol", "canarm_emulator", "canarm_controller"]
DONE = re.compile(r"^Done (\d+) runs in (\d+) second", re.MULTILINE)
COVERED = re.compile(r"cov: (\d+)")


def targets():
    """The module with the targets and their seeds; its imports are instrumented if atheris asks for it."""
    sys.path.insert(0, str(ROOT / "tests" / "fuzz"))
    return importlib.import_module("targets")


def drive(name: str, arguments: list[str]) -> None:
    """In a child process: feed one target for ever, or as libFuzzer's arguments say."""
    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED, enable_loader_override=False):
        target = targets().TARGETS[name]
    atheris.Setup([sys.argv[0], *arguments], target)
    atheris.Fuzz()


def fuzz(name: str, inputs: int, seeds: list[bytes]) -> bool:
    """Run one target with a number of inputs; prints the outcome, returns whether nothing escaped."""
    corpus = KEPT / name / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds):
        (corpus / f"seed-{number}").write_bytes(seed)
    command = [
        sys.executable, __file__, "--drive", name, str(corpus), f"-artifact_prefix={KEPT / name}/", f"-runs={inputs}",
        f"-max_len={LONGEST_INPUT}", "-timeout=20", "-print_final_stats=1", "-seed=1", "-rss_limit_mb=4096",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    said = done.stdout + done.stderr
    count = DONE.search(said)
    if done.returncode or count is None:
        print(f"fuzz: {name}: ESCAPED, or ended early: status {done.returncode}\n{said[-4000:]}", flush=True)
        return False
    edges = COVERED.findall(said)
    print(
        f"fuzz: {name}: {count[1]} inputs in {count[2]} s, {edges[-1] if edges else '?'} edges, 0 escaped", flush=True
    )
    return True


def main() -> int:
    if sys.argv[1:2] == ["--drive"]:
        drive(sys.argv[2], sys.argv[3:])
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=INPUTS, help="of all targets together")
    parser.add_argument("targets", nargs="*", help="these only")
    given = parser.parse_args()
    module = targets()
    names = given.targets or list(module.TARGETS)
    if unknown := set(names) - set(module.TARGETS):
        parser.error(f"no such target: {', '.join(sorted(unknown))}; there are {', '.join(module.TARGETS)}")
    results = [fuzz(name, given.inputs // len(names), module.SEEDS[name]) for name in names]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
