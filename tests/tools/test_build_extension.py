"""The extension's archive: Blender installs it, and its wheel alone gives the add-on the
contract.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import facestage

REPOSITORY = Path(__file__).resolve().parents[2]
MANIFEST = REPOSITORY / "addon" / "facestage_blender" / "blender_manifest.toml"

# Installs the extension into an empty Blender. The working tree's own packages are kept out of
# sight: setuptools' editable finder, and any folder of the tree on the path.
INSTALL = """
import sys
import bpy
def editable(finder):
    return "__editable__" in getattr(finder, "__module__", "")
sys.meta_path = [finder for finder in sys.meta_path if not editable(finder)]
tree = sys.argv[2]
sys.path = [path for path in sys.path if not path.startswith(tree) or "site-packages" in path]
install = bpy.ops.extensions.package_install_files
install(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
import facestage.contract.errors
print("ENABLED", "bl_ext.user_default.facestage_blender" in bpy.context.preferences.addons.keys())
print("FROM", facestage.__file__)
print("TOP", "facestage_blender" in sys.modules)
"""


# Imports every module of the contract and says which packages that loaded.
CONTRACT = """
import importlib, json, pkgutil, sys
import facestage.contract as contract
for found in pkgutil.walk_packages(contract.__path__, "facestage.contract."):
    importlib.import_module(found.name)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The extension, built as `make extension` does."""
    pytest.importorskip("bpy", reason="the extension builder comes with bpy")
    folder = tmp_path_factory.mktemp("dist")
    done = subprocess.run(
        [sys.executable, str(REPOSITORY / "tools" / "build_extension.py"), str(folder)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return next(folder.glob("*.zip"))


def test_archive_holds_the_addon_its_license_and_the_wheel(archive: Path) -> None:
    with zipfile.ZipFile(archive) as extension:
        names = set(extension.namelist())
        manifest = tomllib.loads(extension.read("blender_manifest.toml").decode())
    assert {"__init__.py", "registration.py", "LICENSE"} <= names
    assert not {name for name in names if "__pycache__" in name}
    wheels = [wheel.removeprefix("./") for wheel in manifest["wheels"]]
    assert sorted(wheels) == sorted(name for name in names if name.endswith(".whl"))
    assert [Path(wheel).name.split("-")[0] for wheel in wheels] == ["facestage", "marshmallow"]


def test_wheel_holds_the_backend_and_not_the_addon(archive: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(archive) as extension:
        (wheel,) = [name for name in extension.namelist() if name.startswith("wheels/facestage-")]
        extension.extract(wheel, tmp_path)
    with zipfile.ZipFile(tmp_path / wheel) as package:
        names = package.namelist()
    assert "facestage/contract/errors.py" in names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"facestage"}
    sources = {path.relative_to(REPOSITORY / "backend").as_posix() for path in _sources()}
    assert sources <= set(names)


def test_another_build_has_another_version(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "tools"))
    import build_extension

    with zipfile.ZipFile(archive) as extension:
        (wheel,) = [name for name in extension.namelist() if "/facestage-" in name]
    assert Path(wheel).name.startswith(f"facestage-{facestage.__version__}+g")
    (tmp_path / "a.py").write_text("1", encoding="utf-8")
    before = build_extension.digest(tmp_path)
    assert build_extension.digest(tmp_path) == before
    (tmp_path / "a.py").write_text("2", encoding="utf-8")
    changed = build_extension.digest(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({before, changed, build_extension.digest(tmp_path)}) == 3
    text = '[project]\nversion = "1.2"\n[tool.x]\nversion = "3"\n'
    after = tomllib.loads(build_extension.with_digest(text, "00ab"))
    assert after["project"]["version"] == "1.2+g00ab" and after["tool"]["x"]["version"] == "3"


def test_blender_installs_and_enables_it(archive: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INSTALL, str(archive), str(REPOSITORY)],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)},
    )
    assert "ENABLED True" in done.stdout, done.stdout + done.stderr
    assert f"FROM {tmp_path}" in done.stdout
    assert list(tmp_path.rglob("site-packages/marshmallow/__init__.py")), (
        "what the contract imports comes along"
    )
    assert "TOP False" in done.stdout, (
        "the add-on imports itself by an absolute name, which an extension does not have"
    )


def test_the_contract_loads_what_blender_has_and_what_is_shipped_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "tools"))
    import build_extension

    plain = loaded("import json, numpy, sys; print(json.dumps([n for n in sys.modules]))")
    shipped = {"facestage", *build_extension.LIBRARIES}
    assert loaded(CONTRACT) - plain - set(sys.stdlib_module_names) == shipped


def loaded(code: str) -> set[str]:
    """Top-level packages in a fresh process that runs ``code``, which prints them as JSON."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in json.loads(done.stdout)}


def test_versions_agree() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    manifest = tomllib.loads(MANIFEST.read_text(encoding="utf-8"))
    assert project["version"] == facestage.__version__ == manifest["version"]


def test_manifest_keeps_its_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "tools"))
    import build_extension
    from setup_error import SetupError

    before = 'id = "a"\n\n[permissions]\nfiles = "read"\n'
    after = tomllib.loads(build_extension.with_wheels(before, ["a.whl", "b.whl"]))
    assert after == {**tomllib.loads(before), "wheels": ["./wheels/a.whl", "./wheels/b.whl"]}
    with pytest.raises(SetupError, match="lists wheels already"):
        build_extension.with_wheels("wheels = []\n", ["facestage.whl"])


def test_a_library_is_fetched_with_its_digests_or_not_at_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "tools"))
    import build_extension
    from backend_lock import locked
    from setup_error import SetupError

    lock = (
        "a==1 \\\n    --hash=sha256:1\nb==2 \\\n    --hash=sha256:2 \\\n    "
        "--hash=sha256:3\nbc==4\n"
    )
    assert locked(lock, "b", "lock") == "b==2 \\\n    --hash=sha256:2 \\\n    --hash=sha256:3\n"
    for name in ("bc", "c"):
        with pytest.raises(SetupError, match=f"does not pin {name} with its digests"):
            locked(lock, name, "lock")
    for name in build_extension.LIBRARIES:
        other = (REPOSITORY / "requirements" / "python3.13.txt").read_text(encoding="utf-8")
        assert locked(other, name, "lock") == locked(build_extension.LOCK.read_text(), name, "lock")


def test_it_carries_what_the_backend_is_installed_from(archive: Path) -> None:
    with zipfile.ZipFile(archive) as extension:
        for python in ("3.11", "3.13"):
            lock = extension.read(f"requirements/python{python}.txt").decode()
            pinned = set(re.findall(r"^(\S+)==", lock, re.MULTILINE))
            assert {"mitsuba", "drjit", "numpy", "scipy", "marshmallow", "pillow"} <= pinned
            assert not pinned & {"bpy", "pytest", "ruff", "hypothesis"}
            assert lock.count("==") == len(pinned) and lock.count("--hash=") > len(pinned)


def _sources() -> list[Path]:
    """Every module of the backend on disk."""
    return list((REPOSITORY / "backend" / "facestage").rglob("*.py"))
