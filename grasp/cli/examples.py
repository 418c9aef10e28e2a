"""Examples at the end of a verb's help; a test reads each of them as the command line would."""

EXAMPLES = {
    "run lift": (
        "grasp run lift --object can",
        "grasp run lift --object ./mug.toml --rig simulated --seed 7 --report",
        "grasp run lift --detector mine.py:Tremble --set object.mass_kg=0.3 --json",
        "grasp run lift --rig cell.toml --config grip.toml --trials 20 --confirm-motion",
    ),
    "run tap": (
        "grasp run tap --object ball",
        "grasp run tap --object can --rig simulated --trials 5 --direction side",
    ),
    "run acquire": ("grasp run acquire --surface sphere --direction 45 --seconds 10",),
    "campaign run": (
        "grasp campaign run paper",
        "grasp campaign run mine.toml --jobs 4 --config lab.toml",
        "grasp campaign run mine.toml --resume",
    ),
    "replay": (
        "grasp replay runs/20260102-101500-lift-can --check",
        "grasp replay --tactile fingertip.csv --detector energy",
    ),
    "report": (
        "grasp report runs/20260102-101500-lift-can",
        "grasp report runs/campaigns/paper.sqlite",
        "grasp report scores.json",
    ),
    "export": (
        "grasp export runs/20260102-101500-lift-can --to svg",
        "grasp export runs/campaigns/paper.sqlite --out paper.csv",
    ),
    "status": ("grasp status gripper --config lab.toml", "grasp status arm --config lab.toml"),
    "runs": ("grasp runs", "grasp runs runs/campaigns/paper.sqlite"),
    "config": (
        "grasp config object --object ball",
        "grasp config --config lab.toml --config grip.toml",
        "grasp config mug.toml cell.toml lab.toml",
    ),
    "detector evaluate": (
        "grasp detector evaluate tcn energy --recording fingertip.csv",
        "grasp detector evaluate mine.onnx mine.py:Tremble --data sets/paper",
    ),
    "detector tune": ("grasp detector tune mine.py:Tremble --data sets/paper sets/confusers",),
    "release": ("grasp release --rig cell.toml --confirm-motion",),
    "doctor": (
        "grasp doctor",
        "grasp doctor --rig hardware --config lab.toml",
    ),
    "gripper step": (
        "grasp gripper step --finger B --mm 2 --config lab.toml --confirm-motion",
        "grasp gripper step --finger B --mm 2 --open --config lab.toml --dry-run",
    ),
    "arm step": ("grasp arm step --z 3 --config lab.toml --confirm-motion",),
    "calibrate hand": (
        "grasp calibrate hand --up-to 16 --out hand3.toml --config lab.toml --confirm-motion",
    ),
    "calibrate force": ("grasp calibrate force --finger B --out force-B.toml --config lab.toml",),
    "calibrate noise": (
        "grasp calibrate noise --out rule.toml --config lab.toml --confirm-motion",
    ),
    "emulate": ("grasp emulate --host 127.0.0.2 --gripper-port 5020",),
}
