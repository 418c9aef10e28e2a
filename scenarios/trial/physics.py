"""The contact levels of a simulated run: a table by scenario, and what settings say instead."""

from functools import cache

from grasp.settings import config_dir, load, read_toml
from scenarios.rigs.config import GraspRigConfig
from scenarios.world.settings import ContactLevels, ContactTable


@cache
def contact_table() -> ContactTable:
    """The packaged table. Raises ConfigError."""
    return load(ContactTable, [read_toml(config_dir() / "contact_levels.toml")])


def contact_levels(config: GraspRigConfig, scene: str) -> ContactLevels | None:
    """Levels and steps of a lift, or of a tap by its direction; None on hardware."""
    if config.real:
        return None
    table, world, contact = contact_table(), config.world, config.contact
    rows: list[ContactLevels] = [getattr(table, scene)]
    if config.object.centre_aside_m != 0.0:
        rows.append(table.aside)
    if config.pull.force_n > 0.0:
        rows.append(table.pull)
    level, blow_level = max(row.level for row in rows), max(row.blow_level for row in rows)
    if world.level != "auto":
        level = blow_level = world.level
    if world.blow_level != "auto":
        blow_level = world.blow_level
    return ContactLevels(
        level=level,
        step_s=min(contact.step_s, *(row.step_s for row in rows)),
        blow_level=max(level, blow_level),
        blow_step_s=min(contact.blow_step_s, *(row.blow_step_s for row in rows)),
    )
