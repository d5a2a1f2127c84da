"""The program: ``python -m ros_bridge.mavlink``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("ros_bridge.mavlink.program:main")
