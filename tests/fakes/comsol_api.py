"""A stand-in for the objects of COMSOL's Java API, as MPh hands them to Python: it records the calls, as text.

It has the methods that the exported programs may call and no other. What it prints is what the stand-in of
``test_export_java.py``, which is Java, prints for the same calls.
"""

from __future__ import annotations

Value = str | int | bool


class Api:
    """An object of the API at a path such as ``Model.func.flow``; all share one list of calls."""

    def __init__(self, path: str = "Model", calls: list[str] | None = None, components: tuple[str, ...] = ()) -> None:
        self._path = path
        self._components = components
        self.calls: list[str] = [] if calls is None else calls

    def _at(self, name: str, tag: str | None) -> Api:
        return Api(f"{self._path}.{name}" + (f".{tag}" if tag is not None else ""), self.calls, self._components)

    def _record(self, call: str, *values: Value) -> Api:
        assert all(isinstance(value, Value) for value in values), values  # what JPype turns into Java's own
        texts = [str(value).lower() if isinstance(value, bool) else str(value) for value in values]
        self.calls.append(f"{self._path} {'|'.join([call, *texts])}")
        return self

    def component(self, tag: str | None = None) -> Api:
        return self._at("component", tag)

    def geom(self, tag: str | None = None) -> Api:
        return self._at("geom", tag)

    def param(self) -> Api:
        return self._at("param", None)

    def func(self, tag: str | None = None) -> Api:
        return self._at("func", tag)

    def variable(self, tag: str | None = None) -> Api:
        return self._at("variable", tag)

    def tags(self) -> tuple[str, ...]:
        assert self._path == "Model.component"
        return self._components

    def tag(self) -> str:
        return self._path

    def create(self, tag: str, kind: str | int | bool | None = None) -> Api:
        return self._record("create", tag, *([] if kind is None else [kind]))

    def axisymmetric(self, yes: bool) -> Api:
        return self._record("axisymmetric", yes)

    def label(self, text: str | None = None) -> Api:
        return self._record("label", *([] if text is None else [text]))

    def descr(self, name: str, text: str) -> Api:
        return self._record("descr", name, text)

    def set(self, name: str, value: Value, text: str | None = None) -> Api:
        return self._record("set", name, value, *([] if text is None else [text]))

    def setIndex(self, name: str, value: Value, i: int, j: int | None = None) -> Api:  # noqa: N802 - Java's name
        return self._record("setIndex", name, value, i, *([] if j is None else [j]))

    def importData(self) -> Api:  # noqa: N802 - Java's name
        return self._record("importData")

    def save(self, path: str) -> Api:
        return self._record("save", path)


class ModelUtil:
    """What MPh's `Client.java` is: creates and loads models."""

    def __init__(self, model: Api) -> None:
        self.model = model

    def createUnique(self, prefix: str) -> Api:  # noqa: N802 - Java's name
        assert prefix == "model"
        return self.model

    def uniquetag(self, prefix: str) -> str:
        return f"{prefix}1"

    def load(self, tag: str, path: str) -> Api:
        self.model.calls.append(f"{tag} load|{path}")
        return self.model
