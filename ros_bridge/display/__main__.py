"""``python -m ros_bridge.display``."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("ros_bridge.display.run:main")
