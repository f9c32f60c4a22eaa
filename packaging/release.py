"""Makes a release from a tag: wheels, data, a hub's folder, Zenodo's metadata, checksums; then installs it.

python packaging/release.py TAG DIR     DIR is made anew; TAG is v and the version that the code has there

Everything is made of a clean clone at the tag, so nothing that lies about in this folder gets in. Nothing is uploaded.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tsbench.core.files import sha256_of

ROOT = Path(__file__).resolve().parent.parent
# What a stranger would do first with what was installed.
_TRIAL = ("run", "--planner", "idm", "--split", "dev", "--types", "stop", "--workers", "1", "--out", "trial")


def said(*command: str | Path, cwd: Path, env: Mapping[str, str] | None = None) -> str:
    """What a command prints. Exits with its words where it fails."""
    done = subprocess.run([*map(str, command)], cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout.strip()


def clone_at(tag: str, folder: Path) -> str:
    """A clean clone at the tag; the day of its commit."""
    said("git", "clone", "--quiet", "--depth", "1", "--branch", tag, f"file://{ROOT}", folder, cwd=ROOT)
    version = said(sys.executable, "-c", "import tsbench; print(tsbench.__version__)", cwd=folder)
    if tag != f"v{version}":
        sys.exit(f"{tag}: the code there says that it is {version}: tag v{version}, or change tsbench/__init__.py")
    return said("git", "show", "--no-patch", "--format=%cs", "HEAD", cwd=folder)


def zenodo(citation: Mapping[str, Any], tag: str, day: str) -> dict[str, Any]:
    """Zenodo's metadata of a deposit, from the citation file."""
    return {
        "title": citation["title"],
        "upload_type": "dataset",
        "description": citation["abstract"],
        "version": tag.removeprefix("v"),
        "publication_date": day,
        "creators": [{"name": author["name"]} for author in citation["authors"]],
        "keywords": citation["keywords"],
        "access_right": "open",
        "license": "ODbL-1.0",
        "notes": "Data: ODbL 1.0, © OpenStreetMap contributors. Code: MIT.",
    }


def build(tag: str, out: Path) -> None:
    """Fill `out`, which must not be there."""
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as temporary:
        clone = Path(temporary) / "tsbench"
        day = clone_at(tag, clone)
        wheel = ("-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", out / "wheels")
        said(sys.executable, *wheel, ".", "./packaging/tsbench-data", cwd=clone)
        said(sys.executable, "packaging/data_sets.py", "lay-out", out / "data", cwd=clone)
        said(sys.executable, "packaging/hub.py", out / "hub", "--revision", tag, "--published", day, cwd=clone)
        citation = yaml.safe_load((clone / "CITATION.cff").read_text(encoding="utf-8"))
    told = json.dumps(zenodo(citation, tag, day), indent=1, ensure_ascii=False)
    (out / "zenodo.json").write_text(told + "\n", encoding="utf-8")
    files = sorted(path for path in out.rglob("*") if path.is_file())
    sums = "".join(f"{sha256_of(path)}  {path.relative_to(out).as_posix()}\n" for path in files)
    (out / "SHA256SUMS").write_text(sums, encoding="utf-8")


def try_out(out: Path) -> str:
    """Install both wheels in an environment of their own and drive `dev` there; the last line that was said."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        venv.create(place / "env", with_pip=True)
        pip = (place / "env/bin/python", "-m", "pip", "install", "--quiet")
        said(*pip, "--constraint", ROOT / "requirements.lock", *sorted((out / "wheels").glob("*.whl")), cwd=place)
        # No data folder of this machine's, so that what is used is the wheel's.
        return said(
            place / "env/bin/tsbench", *_TRIAL, cwd=place, env={"PATH": "/usr/bin:/bin", "HOME": temporary}
        ).splitlines()[-1]


def main() -> None:
    match sys.argv[1:]:
        case [tag, folder]:
            build(tag, Path(folder).resolve())
            print(try_out(Path(folder).resolve()))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
