"""Every benchmark, and one table of all: python -m tests.benchmarks --out DIR [--quick] [--peers FOLDER] [--only NAME].

Each benchmark runs in a process of its own, one after the other, so that none warms or burdens another. Writes
``table.json`` (machine, versions, every number) and ``table.md``, what is wanted first. One that fails leaves a line
that says why, and the code is 1.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

from tests.benchmarks.measuring import machine, machine_words, markdown, table
from tests.benchmarks.targets import targets

#: Results in a page stand behind this line.
MARK = "<!-- results -->"
#: In the order of the tables; the name is that of the module.
BENCHMARKS = ("step", "peers", "accuracy", "ensemble", "scaling", "diagnosis")


def run(name: str, out: Path, quick: bool, peers: Path | None) -> dict:
    """One benchmark's part, or the reason why there is none."""
    target = out / f"{name}.json"
    target.unlink(missing_ok=True)
    given = [sys.executable, "-m", f"tests.benchmarks.bench_{name}", "--out", str(target)]
    given += ["--quick"] if quick else []
    given += ["--peers", str(peers)] if name == "peers" and peers is not None else []
    begin = time.perf_counter()
    made = subprocess.run(given, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    took = time.perf_counter() - begin
    if made.returncode or not target.exists():
        said = (made.stderr.strip().splitlines() or ["it said nothing"])[-1][:300]
        return {"name": name, "failed": said, "took_s": took,
                "tables": [table(f"{name}: failed", ["reason"], [[said]])]}  # fmt: skip
    return json.loads(target.read_text()) | {"took_s": took}


def text(found: dict) -> str:
    """All tables as Markdown, the machine first."""
    quick = "A quick run: small sizes, to see that everything runs.\n\n" if found["quick"] else ""
    head = f"{quick}{found['date']}. {machine_words(found['machine'])}\n"
    data = {part["name"]: part["data"] for part in found["parts"] if "data" in part}
    wanted = [] if found["quick"] else targets(data)
    sections = [wanted] if wanted else []
    sections += [part["tables"] for part in found["parts"]]
    return head + "".join("\n" + markdown(tables) for tables in sections)


def put(page: Path, tables: str) -> None:
    """Replace what stands behind the mark of a page by new results."""
    before, mark, _ = page.read_text(encoding="utf-8").partition(MARK)
    if not mark:
        raise SystemExit(f"{page}: expected the line {MARK}, found none. Results go behind it.")
    page.write_text(f"{before}{mark}\n\n{tables}", encoding="utf-8")


def main() -> int:
    """Run what is asked for and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder for table.json and table.md")
    parser.add_argument("--quick", action="store_true", help="small sizes, few repeats: that it runs, not how fast")
    parser.add_argument("--peers", type=Path, help="folder with one virtual environment per peer")
    parser.add_argument("--page", type=Path, help="Markdown page whose results are replaced, as docs/benchmarks.md")
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS, help="these alone")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    found = {"date": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()), "quick": given.quick, "machine": machine()}
    found["parts"] = []
    for name in given.only:
        print(f"{name} ...", file=sys.stderr, flush=True)
        found["parts"].append(run(name, given.out, given.quick, given.peers))
        # Written after each: a run of hours that is stopped leaves what it had.
        (given.out / "table.json").write_text(json.dumps(found, indent=1, allow_nan=False) + "\n")
        (given.out / "table.md").write_text(text(found))
    if given.page is not None:
        put(given.page, text(found))
    failed = [part["name"] for part in found["parts"] if "failed" in part]
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    print(given.out / "table.md")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
