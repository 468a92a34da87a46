"""Job: one network of a run, trained and saved."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import torch

from learn.data.preparation import prepare
from learn.networks.predictor import Predictor
from learn.runs.place import CHECKPOINT
from learn.runs.run import open_run, stem
from learn.training.settings import Job
from learn.training.trainer import Report, Trainer
from twin.errors import InputError


def train(
    job: Job, folder: Path, report: Callable[[Report], None], *, resident: bool = True
) -> Report | None:
    """Train one network and save it; its last report, None when nothing was left to do.

    Args:
      resident: keep the training data in memory; else read them from the store as they are needed.
    """
    config = job.config
    start = None
    if config.start is not None:
        members = open_run(config.start).networks()[job.target].members
        start = members[job.member % len(members)]
        if start.features != config.features:
            raise InputError(f"run {config.start} has other inputs; leave the inputs to --start")
    checkpoint = folder / f"{job.name}{CHECKPOINT}"
    with prepare(
        config.store,
        target=job.target,
        features=config.features,
        division=config.division,
        seed=config.training.seed,
        mirror=config.mirror,
        period=config.period,
        scales=None if start is None else start.normalisation,
        held_out=config.held_out,
        labels=config.labels,
        resident=resident,
    ) as data:
        threads = torch.get_num_threads()
        try:
            trained = Trainer(
                dataclasses.replace(config.network, period=data.period),
                dataclasses.replace(config.training, seed=job.seed),
                data.train,
                data.validation,
                target_scale=data.normalisation.target_scale,
                checkpoint=checkpoint,
                report=report,
                start=None if start is None else start.network.state_dict(),
            ).run()
        finally:
            torch.set_num_threads(threads)  # the caller's, who may go on in this process
    Predictor(trained.network.cpu(), data.normalisation).save(stem(folder, job.target, job.member))
    checkpoint.unlink(missing_ok=True)  # now that what came of it is safe
    return trained.history[-1] if trained.history else None
