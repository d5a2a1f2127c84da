"""A window that shows an encounter while it is flown."""

import math
import time

from envs.gym.gymnasium_contract import error
from envs.gym.rendering import Drawing, Picture


class Window:
    """A window that shows scenes of ``size`` pixels a side at ``fps`` frames a second.

    Raises:
        gymnasium.error.UnsupportedMode: there is no display, or no interactive matplotlib backend.
    """

    def __init__(self, size: int = 600, fps: float = math.inf) -> None:
        import matplotlib.pyplot as plt
        from matplotlib.backends.registry import BackendFilter, backend_registry

        try:
            backend = plt.get_backend()
            if backend.lower() not in backend_registry.list_builtin(BackendFilter.INTERACTIVE):
                raise RuntimeError(f"matplotlib's backend is {backend!r}, which has no window")
            with plt.rc_context({"toolbar": "None"}):
                self._figure = plt.figure(num="RLCAS encounter", clear=True)
        except Exception as problem:
            # Toolkits raise errors of their own where there is no display.
            raise error.UnsupportedMode(
                'render_mode "human": a window needs a display and an interactive matplotlib '
                "backend such as TkAgg or "
                f'QtAgg ({problem}); use render_mode="rgb_array" where there is none'
            ) from problem
        self._pyplot = plt
        self._drawing = Drawing(size, self._figure)
        self._interval = 1.0 / fps
        self._next = time.monotonic()
        self._figure.show()

    @property
    def closed(self) -> bool:
        """Whether the user has closed the window."""
        return not self._pyplot.fignum_exists(self._figure.number)

    def show(self, scene: Picture) -> None:
        """Show the scene and wait until its time in the sequence; nothing happens once the window
        is closed.
        """
        if self.closed:
            return
        self._drawing.update(scene)
        canvas = self._figure.canvas
        canvas.flush_events()
        self._next = max(self._next + self._interval, time.monotonic())
        wait = self._next - time.monotonic()
        if wait > 0.0:
            canvas.start_event_loop(wait)

    def close(self) -> None:
        """Close the window."""
        self._pyplot.close(self._figure)
