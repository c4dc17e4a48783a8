"""Visitors who fit at the same time: all get their answers, one after another."""

import gc
from importlib.util import find_spec
from threading import Event, Lock, Thread
from types import SimpleNamespace

import pytest

from kfit.app import line as module
from kfit.app.line import Line
from kfit.app.session import Session
from kfit.app.sessions import Sessions


def test_each_waits_for_those_before_and_sees_how_many_they_are(monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.01)
    line = Line()
    first, second, third = line.joined(), line.joined(), line.joined()
    assert list(first.__enter__()) == []
    before_second, before_third = second.__enter__(), third.__enter__()
    assert [next(before_second), next(before_third), next(before_third)] == [1, 2, 2]
    first.__exit__(None, None, None)
    assert list(before_second) == []
    assert next(before_third) == 1
    second.__exit__(None, None, None)
    assert list(before_third) == []


def test_who_gives_up_is_waited_for_by_nobody():
    line = Line()
    with line.joined():
        with pytest.raises(KeyError), line.joined():
            raise KeyError
        with line.joined() as waiting:
            assert next(waiting) == 1


def test_a_full_line_says_so():
    line, inside = Line(), []
    for _ in range(module.MOST):
        inside.append(line.joined())
        inside[-1].__enter__()
    with pytest.raises(ValueError, match=r"^20 people are waiting"), line.joined():
        pass


def twelve_visits(folder, monkeypatch):
    """What each of twelve visitors is shown who press Fit at once, and how many fits ran."""
    from kfit.app import actions as shown
    from kfit.app.page import page

    alone, begun, running = Lock(), Event(), []

    def fit(self, category, camera):
        assert alone.acquire(blocking=False), "two fits run at once"
        running.append(self)
        begun.wait(20)
        alone.release()
        yield SimpleNamespace(visitor=self)

    monkeypatch.setattr(module, "PATIENCE", 0.01)
    monkeypatch.setattr(Session, "fit", fit)
    monkeypatch.setattr(Session, "image", None)
    monkeypatch.setattr(Session, "write", lambda self, result, camera: {})
    monkeypatch.setattr(shown, "scene", lambda result: {})
    monkeypatch.setattr(shown, "scene_html", lambda result, made: "")
    monkeypatch.setattr(shown.views, "answered", lambda result, steps: f"answer of {result.visitor.folder.name}")
    called = [fn.fn for fn in page(Sessions(folder)).fns.values() if getattr(fn.fn, "__name__", "") == "run"]
    run, view = called[0], called[0].__self__.parts.view
    recorded = {str(k): [] for k in range(12)}

    def visit(name):
        for changes in run(name, "mug", ""):
            recorded[name].append(str(changes.get(view, "")))
            if "before yours" in recorded[name][-1] and all(recorded.values()):
                begun.set()

    threads = [Thread(target=visit, args=(name,), daemon=True) for name in recorded]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    return list(recorded.values()), len(running)


@pytest.mark.slow
# Gradio leaves event loops and sockets to the garbage collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.skipif(find_spec("gradio") is None, reason="gradio is not installed")
def test_twelve_visitors_at_once_all_get_an_answer(tmp_path, monkeypatch):
    shown, num_fits = twelve_visits(tmp_path, monkeypatch)
    answers = [[text for text in texts if text.startswith("answer of")] for texts in shown]
    assert all(len(texts) == 1 for texts in answers)
    assert len({texts[0] for texts in answers}) == num_fits == 12
    assert any("11 other fits are before yours" in text for texts in shown for text in texts)
    gc.collect()
