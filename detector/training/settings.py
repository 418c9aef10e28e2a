"""Which networks there are, and how each is trained by default. Needs no torch."""

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

# a shift is how far a taxel stands from its own mean of SHIFT_MEAN samples, SHIFT_LAG ago: what a
# slip leaves behind, however short it was, as long as the mean has not followed
SHIFT_LAG, SHIFT_MEAN = 9, 30
SHIFT_SCALE_COUNTS = 8.0  # of the asinh: linear for noise, a logarithm for impacts
SHIFT_REACH = SHIFT_LAG + SHIFT_MEAN - 1  # samples before the newest


class Architecture(msgspec.Struct, frozen=True, kw_only=True):
    """What distinguishes one network from another; stored with its weights."""

    family: Literal["tcn", "gru", "freq-cnn"]
    taxels: int = KIT_TAXELS  # of a fingertip; a freq-cnn's image has the kit's
    inputs: tuple[Input, ...] = ("counts",)
    kernel: int = 8
    dilations: tuple[int, ...] = (1, 2, 4, 8)
    channels: int = 12
    head: int = 24
    dropout: float = 0.2  # the authors'
    outputs: int = 2  # 2: softmax of static and slip, 1: log-odds
    streaming: bool = False  # dense outputs, explicit state; otherwise the window's last step
    window: int = WINDOW  # samples that a tcn sees which is no stream
    norm: bool = True  # of a tcn: layer norm, as the paper has it
    gated: bool = False  # of a tcn: one gated convolution a block, a linear head on all of them
    held: int = 1  # of a gated tcn: samples whose greatest features its head takes

    @property
    def memory(self) -> int:
        """Samples that one output of a `tcn` depends on; a block has two convolutions, or a gated
        one."""
        convolutions = 1 if self.gated else 2
        reach = SHIFT_REACH if "shifts" in self.inputs else int("changes" in self.inputs)
        return self.held + convolutions * (self.kernel - 1) * sum(self.dilations) + reach


def shift_taps() -> tuple[int, ...]:
    """What a shift is of the changes up to now, the newest last, each times SHIFT_MEAN: whole
    numbers, so that any order of summation agrees. The past before a reset is no change."""
    ages = range(SHIFT_REACH - 1, -1, -1)
    return tuple(SHIFT_MEAN if age < SHIFT_LAG else SHIFT_REACH - age for age in ages)


def of_layout(name: str, taxels: int) -> Architecture:
    """The named network for fingertips of so many taxels; raises UsageError where its image of
    taxels has no place for them."""
    arch = ARCHITECTURES[name]
    if arch.family == "freq-cnn":
        check_layout(name, arch.taxels, taxels)
    return msgspec.structs.replace(arch, taxels=taxels)


ARCHITECTURES = {
    # 10,070 parameters; its receptive field of 211 exceeds the window, so the zero padding counts
    "tcn-paper": Architecture(family="tcn"),
    # 99 samples at most: window and stream are equal. A detection is held as long as an impact is
    # slip (`sequences.IMPACT_SAMPLES`): so the fingers of a hand, struck one after another, agree
    "tcn": Architecture(
        family="tcn", gated=True, inputs=EVERY, kernel=3, dilations=(1, 2, 4, 8, 8), channels=17,
        held=15, dropout=0.0, outputs=1, streaming=True,
    ),
    "gru": Architecture(family="gru", inputs=EVERY, channels=32, outputs=1, streaming=True),
    "freq-cnn-paper": Architecture(family="freq-cnn"),
}  # fmt: skip


class TrainSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a network is trained; stored in its checkpoints. The command line bounds what it sets."""

    steps: int  # of the optimiser, planned
    dense: bool = True  # learn from every sample of a stretch, not from a window's last
    augmentation: Augmentation = "ours"
    balance: Balance = "weights"
    label: LabelName = "slip"  # by speed; slip_true: by the contact's own; moved: by the distance
    seed: int = 0
    window: int = WINDOW  # samples that `tcn-paper` sees
    norm: bool = True  # layer norm in `tcn-paper`, as in the paper
    batch: int = 16  # stretches or windows a step
    crop: int = 160  # samples learnt from a stretch
    warm: int = 99  # samples before them; more than the network's memory
    fresh: float = 0.25  # share learnt from the first sample on
    near_impacts: float = 0.0  # share of the stretches drawn for an impact
    evenness: float = 0.0  # 0: causes as often as they have samples, 1: each as often as any other
    learning_rate: float = 0.004
    final_rate: float = 0.02  # share of the rate left at the end, by a cosine
    validations: int = 16  # evenly over the steps
    patience: int = 8  # validations without a better one that end it


# `tcn-paper` learns from every sample of stretches as long as its window, with the zeros before it
# that the network will see: a hundred labels at the cost of one. `--windows`: as its authors did.
DEFAULTS = {
    "tcn": TrainSettings(
        steps=12_000, validations=6, learning_rate=0.008, batch=32, near_impacts=0.4, evenness=0.5
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
