import os

from sumo_dist.terminal import say


def test_what_nobody_reads_is_lost_and_harms_nothing():
    reading, writing = os.pipe()
    stream = os.fdopen(writing, "w")
    say("one", stream)
    assert os.read(reading, 100) == b"one\n"
    os.close(reading)
    for _ in range(3):
        say("two", stream)
    stream.write("three")
    stream.close()  # as Python does at its end


def test_it_is_said_to_people_on_stderr(capsys):
    say("hello")
    assert capsys.readouterr() == ("", "hello\n")
