"""What the built zip holds."""

from __future__ import annotations

import tomllib
import zipfile

import pytest

import cbm_addon


@pytest.fixture
def names(built_zip):
    return zipfile.ZipFile(built_zip).namelist()


@pytest.fixture
def manifest(built_zip):
    return tomllib.loads(zipfile.ZipFile(built_zip).read("blender_manifest.toml").decode())


def test_manifest_lists_exactly_the_wheels_inside(names, manifest):
    wheels = [name for name in names if name.endswith(".whl")]
    assert wheels
    assert sorted(manifest["wheels"]) == sorted(f"./{wheel}" for wheel in wheels)


def test_only_onnxruntime_is_bundled(manifest):
    """Blender brings numpy, and training brings its own Python with torch."""
    assert {wheel.split("/")[-1].split("-")[0] for wheel in manifest["wheels"]} == {"onnxruntime"}


def test_it_holds_the_extension_and_nothing_else(names):
    assert {name.split("/")[0] for name in names} == {"__init__.py", "blender_manifest.toml", "LICENSE", "cbm_addon", "operators", "panels", "wheels"}
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]


def test_it_holds_the_shipped_model_and_the_sample_take(names):
    assert [name for name in names if name.startswith("cbm_addon/models/") and name.endswith(".onnx")]
    assert [name for name in names if name.startswith("cbm_addon/takes/sample/") and name.endswith(".csv")]


def test_its_name_and_manifest_carry_the_version(built_zip, manifest):
    assert manifest["version"] == cbm_addon.__version__
    assert built_zip.name == f"cbm-{cbm_addon.__version__}.zip"
