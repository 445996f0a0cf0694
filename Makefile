# make bake    sets up everything and bakes a take onto a rig, from the packaged extension
#              TAKE=recording RIG=armature BLEND=scene.blend PART=lower OUT=folder
# make test    sets up everything and runs every test
# make train   trains a model: DATA=folder of BVH files, MODEL=folder to write
# make clean   removes what make made

PYTHON ?= python3.11
TAKE ?= cbm_addon/takes/sample/walk_turn_crouch.csv
OUT ?= out
DATA ?= ../shared/mocap/core
MODEL ?= runs/model

VERSION := $(shell sed -n 's/^version = "\(.*\)"/\1/p' blender_manifest.toml)
ZIP := dist/cbm-$(VERSION).zip
CONTENT := $(shell find __init__.py blender_manifest.toml LICENSE cbm_addon operators panels -type f -not -path '*/__pycache__/*')
BLENDER := .venv-blender/bin/python -I

.PHONY: bake test train libraries clean

bake: $(ZIP) | .venv/ready libraries
	@mkdir -p "$(OUT)"
	@$(BLENDER) build_addon.py --run $(ZIP) bake "$(TAKE)" $(if $(RIG),--rig "$(RIG)",--preset rigify) $(if $(BLEND),--blend "$(BLEND)") \
		$(if $(PART),--part $(PART)) -o "$(OUT)/bake.blend" --preview "$(OUT)/bake.mp4" --preview "$(OUT)/bake.png" --overwrite

test: .venv-dev/ready | libraries
	.venv-dev/bin/ruff check .
	.venv-dev/bin/python -m pytest

train: .venv-dev/ready
	.venv-dev/bin/cbm train "$(DATA)" -o "$(MODEL)" --resume

$(ZIP): $(CONTENT) build_addon.py constraints.txt | .venv-blender/ready
	@.venv-blender/bin/python build_addon.py

libraries: .venv-blender/ready
	@$(BLENDER) build_addon.py --check

# Blender as a Python module, and nothing else: what the extension needs must come out of its zip.
.venv-blender/ready: constraints.txt
	@$(PYTHON) -c 'import sys, ensurepip; assert sys.version_info[:2] == (3, 11)' 2>/dev/null || \
		{ echo "error: $(PYTHON): is not Python 3.11 with venv; apt-get install python3.11-venv, or name one: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	$(PYTHON) -m venv --clear .venv-blender
	.venv-blender/bin/pip install -c constraints.txt bpy
	@touch $@

# The other environments see that Blender through a path file, so that its gigabyte is installed once.
.venv/ready: EXTRAS := blender
.venv-dev/ready: EXTRAS := blender,train,dev
.venv/ready .venv-dev/ready: pyproject.toml .venv-blender/ready
	$(PYTHON) -m venv --clear $(@D)
	@echo ../../../../.venv-blender/lib/python3.11/site-packages > $(@D)/lib/python3.11/site-packages/blender.pth
	$(@D)/bin/pip install -c constraints.txt -e ".[$(EXTRAS)]"
	@touch $@

clean:
	rm -rf .venv .venv-blender .venv-dev dist out wheels
