"""Histories keep whole lines in the order of time, and an order is taken once."""

from chaos import history
from chaos.history import History
from chaos.orders import Orders


def test_lines_of_several_writers_come_in_the_order_of_time(tmp_path):
    first, second = History(tmp_path, "first"), History(tmp_path, "second")
    for number, each in enumerate((first, second, first)):
        each("did", number=number)
    for each in (first, second):
        each.close()
    lines = history.read(tmp_path)
    assert [(line.who, line.more) for line in lines] == [
        ("first", {"number": 0}),
        ("second", {"number": 1}),
        ("first", {"number": 2}),
    ]


def test_an_order_is_taken_once_and_by_him_alone(tmp_path):
    orders = Orders(tmp_path)
    orders.give("late", "robot-1")
    assert orders.stands("late", "robot-1")
    assert not orders.take("late", "robot-0")
    assert orders.take("late", "robot-1")
    assert not orders.take("late", "robot-1")
    assert not orders.stands("late", "robot-1")
