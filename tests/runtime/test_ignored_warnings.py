"""Warnings are silenced for a while, also by several threads at once."""

import warnings
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest

from kfit.runtime.ignored_warnings import ignore_warnings


def test_what_is_warned_of_inside_is_silent_and_filters_are_as_before():
    before = list(warnings.filters)
    with ignore_warnings():
        warnings.warn("of nothing", stacklevel=1)
        with ignore_warnings():
            pass
        warnings.warn("of nothing", stacklevel=1)
    assert warnings.filters == before
    with pytest.raises(ZeroDivisionError), ignore_warnings():
        raise ZeroDivisionError
    assert warnings.filters == before


def test_threads_that_overlap_leave_the_filters_as_they_were():
    before = list(warnings.filters)
    inside, left = Barrier(2), Barrier(2)

    def first():
        with ignore_warnings():
            inside.wait()
        left.wait()

    def second():
        with ignore_warnings():
            inside.wait()
            left.wait()  # ends after the first, and began before it ended
            warnings.warn("of nothing", stacklevel=1)

    with ThreadPoolExecutor(2) as pool:
        for ended in (pool.submit(first), pool.submit(second)):
            ended.result()
    assert warnings.filters == before
