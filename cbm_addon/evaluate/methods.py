"""The methods that a score card compares: each answers a calibrated take, for a body, with a performance."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from pathlib import Path

from ..errors import InputError
from ..features import proportions_of
from ..learn.dataset import find_clips, read_datasets
from ..learn.split import read_split
from ..motion.skeleton import Skeleton
from ..progress import Job, Progress, part
from ..solve.models import Model
from ..solve.perform import SolveOptions, perform
from ..solve.performance import Performance
from ..takes.take import Take
from . import METHODS
from .baselines import carry_legs, shuffle_codes
from .motion_matching import Database, index_database, match_motion

Method = Callable[[Take, Skeleton, SolveOptions], Job[Performance]]

OF_A_MODEL = ("ours", "shuffled-codes")
OF_A_DATABASE = ("motion-matching",)


def prepare_methods(names: Iterable[str], modes: Iterable[str], model: Model | None, database: list[Path]) -> Generator[Progress, None, dict[str, Method]]:
    """The methods of these names (of METHODS), ready for these modes; `model` for OF_A_MODEL, clips to search for OF_A_DATABASE.

    Of the database only clips that train are used. InputError if the model lacks a mode or there is no database.
    """
    databases: dict[str, Database] = {}
    if set(names) & set(OF_A_DATABASE):
        databases = yield from _databases(database, list(modes))
    methods: dict[str, Method] = {}
    for name in names:
        if name in OF_A_MODEL:
            if model is None:
                raise ValueError(f"{name} needs a model")
            for mode in modes:
                model.networks(mode)
            methods[name] = of_model(model, shuffled=name == "shuffled-codes")
        elif name in OF_A_DATABASE:
            methods[name] = of_databases(databases)
        else:
            methods[name] = legs_carried
    return methods


def rival_methods(models: Iterable[Model], modes: Iterable[str]) -> dict[str, Method]:
    """Other models as methods by the names in their cards. A model whose codes were not drawn in training, or that has the paper's loss, answers
    with its likeliest code alone. InputError for two models of one name or a model that lacks a mode."""
    methods: dict[str, Method] = {}
    for model in models:
        if model.name in methods or model.name in METHODS:
            raise InputError(model.folder, f"has the name '{model.name}', which another method has; give its card another")
        for mode in modes:
            model.networks(mode)
        methods[model.name] = greedy(of_model(model)) if _greedy(model) else of_model(model)
    return methods


def _greedy(model: Model) -> bool:
    configuration = model.card["training"].get("configuration", {})
    return not configuration.get("sampled", True) or configuration.get("matching") == "paper"


def greedy(method: Method) -> Method:
    """The method with one candidate, which is its likeliest answer."""
    return lambda take, body, options: method(take, body, replace(options, candidates=1, variation=0))


def of_model(model: Model, shuffled: bool = False) -> Method:
    """The solver with a model; `shuffled` deals its codes to other frames."""

    def method(take: Take, body: Skeleton, options: SolveOptions) -> Job[Performance]:
        used = shuffle_codes(model, options.seed) if shuffled else model
        return perform(take, body.height_above_toes("Head"), proportions_of(body), used, options)

    return method


def of_databases(databases: dict[str, Database]) -> Method:
    """Motion matching against the database of each mode."""

    def method(take: Take, body: Skeleton, options: SolveOptions) -> Job[Performance]:
        yield Progress(0, "searching")
        return match_motion(take, body.height_above_toes("Head"), databases[options.mode])

    return method


def legs_carried(take: Take, body: Skeleton, options: SolveOptions) -> Job[Performance]:
    yield Progress(0, "carrying legs")
    return carry_legs(take, body, causal=options.mode == "causal")


def _databases(folders: list[Path], modes: list[str]) -> Generator[Progress, None, dict[str, Database]]:
    if not folders:
        raise InputError("--database", "is missing; motion-matching searches clips: name files or folders of training clips")
    datasets = yield from part(read_datasets(find_clips(folders), read_split()), 0, 0.5)
    databases = {}
    for i, mode in enumerate(modes):
        share = 0.5 / len(modes)
        databases[mode] = yield from part(index_database(datasets["train"], mode), 0.5 + i * share, 0.5 + (i + 1) * share)
    return databases
