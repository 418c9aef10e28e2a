"""The networks and their default training settings. Does not need torch."""

from typing import Literal

import msgspec

from detector.network_file import check_layout
from detector.recordings import LabelName
from detector.training.augment import Augmentation
from detector.training.sequences import Balance
from drivers.interfaces import KIT_TAXELS

WINDOW = 100  # samples: one second, the paper's
NORM_EPS = 1e-3  # of the authors' layer norms

Input = Literal["counts", "changes", "shifts"]
EVERY: tuple[Input, ...] = ("shifts", "changes", "counts")

# A shift is the difference of a taxel to its mean over SHIFT_MEAN samples, SHIFT_LAG samples ago:
# the lasting effect of a slip, also of a short one, until the mean has followed.
SHIFT_LAG, SHIFT_MEAN = 9, 30
SHIFT_SCALE_COUNTS = 8.0  # of the asinh: linear for noise, a logarithm for impacts
SHIFT_REACH = SHIFT_LAG + SHIFT_MEAN - 1  # samples before the newest


class Architecture(msgspec.Struct, frozen=True, kw_only=True):
    """Architecture of a network."""

    family: Literal["tcn", "gru", "freq-cnn"]
    taxels: int = KIT_TAXELS  # of a fingertip; a freq-cnn needs the kit's
    inputs: tuple[Input, ...] = ("counts",)
    kernel: int = 8
    dilations: tuple[int, ...] = (1, 2, 4, 8)
    channels: int = 12
    head: int = 24
    dropout: float = 0.2  # the authors'
    outputs: int = 2  # 2: softmax of static and slip, 1: log-odds
    streaming: bool = False  # dense outputs, explicit state; otherwise the window's last step
    gated: bool = False  # of a tcn: one gated convolution a block, a linear head on all of them
    held: int = 1  # of a gated tcn: samples of the running maximum in the head
    mirrored: bool = False  # a mirror image of the pad has the same inputs
    parts: tuple["Architecture", ...] = ()  # gated tcns whose log-odds are averaged

    @property
    def memory(self) -> int:
        """Samples that one output of a `tcn` depends on."""
        if self.parts:
            return max(part.memory for part in self.parts)
        convolutions = 1 if self.gated else 2
        reach = SHIFT_REACH if "shifts" in self.inputs else int("changes" in self.inputs)
        return self.held + convolutions * (self.kernel - 1) * sum(self.dilations) + reach


def shift_taps() -> tuple[int, ...]:
    """Weights of the past changes in a shift, the newest last, times SHIFT_MEAN: whole numbers, so
    that the sum does not depend on its order. Changes before a reset are 0."""
    ages = range(SHIFT_REACH - 1, -1, -1)
    return tuple(SHIFT_MEAN if age < SHIFT_LAG else SHIFT_REACH - age for age in ages)


def of_layout(name: str, taxels: int) -> Architecture:
    """Architecture of the named network for that number of taxels. Raises UsageError for a
    freq-cnn with another number than the kit's."""
    arch = ARCHITECTURES[name]
    if arch.family == "freq-cnn":
        check_layout(name, arch.taxels, taxels)
    parts = tuple(msgspec.structs.replace(part, taxels=taxels) for part in arch.parts)
    return msgspec.structs.replace(arch, taxels=taxels, parts=parts)


# Memory of 99 samples at most, so window and stream are equal. The running maximum is as long as
# the label of an impact (IMPACT_SAMPLES), which reaches the fingers one after another.
GATED = Architecture(
    family="tcn", gated=True, inputs=EVERY, kernel=3, dilations=(1, 2, 4, 8, 8), channels=17,
    held=15, dropout=0.0, outputs=1, streaming=True, mirrored=True,
)  # fmt: skip
TAXELS = msgspec.structs.replace(GATED, inputs=EVERY[1:], channels=12, mirrored=False)
ARCHITECTURES = {
    # 10,070 parameters; its receptive field of 211 exceeds the window, so zero padding matters
    "tcn-paper": Architecture(family="tcn"),
    # A shift shows that slip has displaced the pad, but once it is gone, slip that goes on looks
    # like rest. Of two networks, one with and one without shifts, each errs elsewhere.
    "tcn": Architecture(family="tcn", streaming=True, parts=(GATED, TAXELS)),
    "gru": Architecture(
        family="gru", inputs=EVERY, channels=32, outputs=1, streaming=True, mirrored=True
    ),
    "freq-cnn-paper": Architecture(family="freq-cnn"),
}  # fmt: skip


class TrainSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Training settings, stored in the checkpoints."""

    steps: int  # planned steps of the optimiser
    dense: bool = True  # every sample of a crop has a loss, not just a window's last
    augmentation: Augmentation = "ours"
    balance: Balance = "weights"
    label: LabelName = "slip"  # by speed; slip_true: of the contact; moved: by displacement
    seed: int = 0
    batch: int = 16  # crops or windows a step
    crop: int = 160  # samples of a crop with a loss
    warm: int = 99  # samples before them; more than the network's memory
    fresh: float = 0.25  # share of the crops with a loss from the first sample on
    near_impacts: float = 0.0  # share of the crops around an impact
    evenness: float = 0.0  # 0: causes are sampled by their number of samples, 1: all equally
    learning_rate: float = 0.004
    final_rate: float = 0.02  # final learning rate over the initial one (cosine schedule)
    validations: int = 16  # evenly over the steps
    patience: int = 8  # validations in a row without improvement that end the training


# `tcn-paper` learns from every sample of crops as long as its window, after the same zero padding
# as at run time: a hundred labels at the cost of one. `--windows`: as its authors did.
DEFAULTS = {
    "tcn": TrainSettings(
        steps=6_000, validations=4, learning_rate=0.008, batch=32, near_impacts=0.4, evenness=0.5
    ),
    "gru": TrainSettings(steps=7_000, validations=5, batch=32, near_impacts=0.4, evenness=0.5),
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
