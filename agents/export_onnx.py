"""``python -m agents.export_onnx``: see :mod:`agents.learning.onnx`."""

from commands.command import run_cli

if __name__ == "__main__":
    run_cli("agents.learning.onnx:main")
