"""Things of one kind by name: those that ship, and the user's own."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from commands.command import InputError
from commands.extension import is_extension, load_extension
from commands.names import one_of

Thing = TypeVar("Thing")


@dataclass
class Registry(Generic[Thing]):
    """Things of one kind by name, in order: those that ship, then those of the user's own.

    The user's own come in by a call (:meth:`register`) or by a name of the form ``module:name``
    (:meth:`resolve`, :meth:`load`): call these two only with what the user has written by hand,
    never with what a file of data says.
    """

    word: str  # for one of them, in messages: "scenario"
    meaning: str  # what each of them is, in messages: "a scenario (envs.encounters.Sampler)"
    kind: type  # of which each of them is an instance
    error: type[InputError]  # that is raised
    shipped: Mapping[str, Thing] = field(default_factory=dict)
    check: Callable[[str, Thing], None] = lambda name, thing: None
    """Raises an error where a thing of the user's own cannot be used."""
    own: dict[str, Thing] = field(default_factory=dict)
    """Those of this process that are the user's own, by name."""

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter((*self.shipped, *self.own))

    def __contains__(self, name: str) -> bool:
        """Return whether a name ships or has been registered; nothing is imported."""
        return name in self.shipped or name in self.own

    def find(self, name: str) -> Thing:
        """Return what ships or has been registered under a name; nothing is imported. Raises the
        registry's error where there is nothing of that name.
        """
        if name not in self:
            raise self.error(f"{self.word} {name!r} is unknown; {self.expected(name)}")
        return self.shipped[name] if name in self.shipped else self.own[name]

    def expected(self, name: str, more: str = "module:name of your own") -> str:
        """Return the end of a refusal of a name: the known ones, ``more``, the nearest one."""
        return one_of(name, self, more)

    def register(self, name: str, entry: Thing) -> Thing:
        """Make a thing of the user's own known in this process under a name, and return it.

        One of the same name is replaced, as when a notebook's cell is run again; a name that ships
        is refused, and so is what is of another kind or cannot be used, by the registry's error.
        """
        if name in self.shipped:
            raise self.error(f"{self.word} {name!r} ships; expected another name")
        self._check_kind(name, entry)
        self.check(name, entry)
        self.own[name] = entry
        return entry

    def load(self, name: str) -> Thing:
        """Return what the user names: what is known, or what ``module:name`` names, which is
        imported. Raises the registry's error where there is none.
        """
        if name in self or not is_extension(name):
            return self.find(name)
        try:
            entry = load_extension(name, self.meaning)
        except InputError as problem:
            raise self.error(str(problem)) from problem.__cause__
        self._check_kind(name, entry)
        return entry

    def resolve(self, name: str) -> Thing:
        """Return what :meth:`load` does, and register what was not known under its name."""
        return self.find(name) if name in self else self.register(name, self.load(name))

    def _check_kind(self, name: str, entry: Any) -> None:
        if not isinstance(entry, self.kind):
            raise self.error(
                f"{self.word} {name!r} is of type {type(entry).__name__}; expected {self.meaning}"
            )
