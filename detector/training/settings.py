"""What a training is told, and the defaults of each network."""

from typing import Annotated

import msgspec
from msgspec import Meta

from detector.recordings import MOVED_M, LabelName
from detector.training.architecture import WINDOW
from detector.training.augment import Augmentation
from detector.training.sequences import Balance


class TrainSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How long, on what, and how a network is trained; stored in its checkpoints."""

    steps: Annotated[int, Meta(ge=1, le=10_000_000, description="optimiser steps planned")]
    dense: Annotated[
        bool,
        Meta(description="learn from every sample of a stretch, not from a window's last"),
    ] = True
    augmentation: Augmentation = "ours"
    balance: Balance = "weights"
    label: Annotated[
        LabelName,
        Meta(description="slip: by speed; slip_true: by the contact's own; moved: by the distance"),
    ] = "slip"
    moved_m: Annotated[
        float,
        Meta(gt=0.0, le=0.1, description="of the label moved: further from where it last rested"),
    ] = MOVED_M
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    window: Annotated[
        int, Meta(ge=2, le=WINDOW, description="samples that `tcn-paper` sees; the paper's: 100")
    ] = WINDOW
    norm: Annotated[bool, Meta(description="layer norm in `tcn-paper`, as in the paper")] = True
    batch: Annotated[int, Meta(ge=2, le=4096, description="stretches or windows a step")] = 16
    crop: Annotated[int, Meta(ge=1, le=4096, description="samples learnt from a stretch")] = 160
    warm: Annotated[
        int, Meta(ge=0, le=4096, description="samples before them; more than the network's memory")
    ] = 99
    fresh: Annotated[
        float, Meta(ge=0.0, le=1.0, description="share learnt from the first sample on")
    ] = 0.25
    near_blows: Annotated[
        float, Meta(ge=0.0, le=1.0, description="share of the stretches drawn for a blow")
    ] = 0.0
    evenness: Annotated[
        float, Meta(ge=0.0, le=1.0, description="0: causes as often as they have samples, 1: each "
                    "as often as any other")
    ] = 0.0  # fmt: skip
    learning_rate: Annotated[float, Meta(gt=0.0, le=0.1)] = 0.004
    final_rate: Annotated[
        float, Meta(gt=0.0, le=1.0, description="share of the rate left at the end, by a cosine")
    ] = 0.02
    clip_norm: Annotated[float, Meta(gt=0.0, description="of the gradient; the authors': 1")] = 1.0
    validations: Annotated[int, Meta(ge=1, le=1000, description="evenly over the steps")] = 16
    patience: Annotated[
        int, Meta(ge=1, description="validations without a better one that end it")
    ] = 8
    budget_per_min: Annotated[
        float, Meta(gt=0.0, description="false events over three fingers at which validation asks "
                    "for the delay")
    ] = 1.0  # fmt: skip


# A window costs as much as a stretch of its length and gives one label instead of a hundred. So
# `tcn-paper` too learns from every sample of stretches as long as its window, each with the zeros
# before it that the network will see; `--windows` trains it as its authors did.
DEFAULTS = {
    "tcn": TrainSettings(
        steps=12_000, validations=6, learning_rate=0.008, batch=32, near_blows=0.4, evenness=0.5
    ),
    "gru": TrainSettings(steps=7_000, validations=5, batch=32, near_blows=0.4, evenness=0.5),
    "tcn-paper": TrainSettings(
        steps=12_000, augmentation="as-run", batch=64, crop=100, warm=0, fresh=1.0,
        learning_rate=0.002, validations=2,
    ),
    "freq-cnn-paper": TrainSettings(
        steps=10_000, dense=False, augmentation="none", balance="undersample", batch=256,
        learning_rate=0.002, validations=4,
    ),
}  # fmt: skip
WINDOWS = {"dense": False, "balance": "undersample", "batch": 256, "final_rate": 1.0}
