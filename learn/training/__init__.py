"""Training: fit a run's networks to missions, several at a time."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from learn.training.fit_config import TrainingJob as TrainingJob
    from learn.training.fit_config import fit_settings as fit_settings
    from learn.training.fitting import fit as fit
    from learn.training.resources import Resources as Resources
    from learn.training.resources import training_resources as training_resources
    from learn.training.settings import CHOICES as CHOICES
    from learn.training.settings import FitSettings as FitSettings
    from learn.training.trainer import TrainingReport as TrainingReport

__getattr__, __dir__ = attach(__name__, places(__name__))
