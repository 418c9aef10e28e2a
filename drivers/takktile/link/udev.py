"""Who may open the board on Linux: the udev rule, and where it goes.

``uaccess`` gives the device to whoever sits at the machine. systemd applies it in 73-seat-late,
so the file must sort before that.
"""

from drivers.takktile.protocol import PRODUCT_ID, VENDOR_ID

RULE_FILE = "/etc/udev/rules.d/60-takktile.rules"

RULE = (
    f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{VENDOR_ID:04x}", ATTR{{idProduct}}=="{PRODUCT_ID:04x}",'
    ' MODE="0660", TAG+="uaccess"'
)

INSTALL = (
    f"echo '{RULE}' | sudo tee {RULE_FILE} && sudo udevadm control --reload && "
    "sudo udevadm trigger --subsystem-match=usb"
)
