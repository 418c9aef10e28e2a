"""`python -m drivers.ur.emulator`: one emulated controller, for any client."""

from drivers.ur.emulator.robot import main

if __name__ == "__main__":
    main()
