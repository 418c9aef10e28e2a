"""Order for an emulated cell, as its process reads it."""

from typing import Self

import msgspec

from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, PressRigConfig, part


class CellOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a cell: a hand around an object, or one fingertip on a surface."""

    seed: int
    grasp: GraspRigConfig | None = None
    press: PressRigConfig | None = None

    @classmethod
    def of(cls, config: AnyRigConfig, seed: int) -> Self:
        """Order from the sections of ``config`` that a cell needs."""
        if isinstance(config, GraspRigConfig):
            return cls(seed=seed, grasp=part(config, GraspRigConfig))
        return cls(seed=seed, press=part(config, PressRigConfig))

    @property
    def config(self) -> AnyRigConfig:
        """Settings of the grasp or of the press. Raises ValueError without either."""
        config = self.grasp or self.press
        if config is None:
            raise ValueError("the order has neither grasp nor press settings")
        return config
