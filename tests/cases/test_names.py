KIND = "names and paths"


def test_a_task_that_is_not_there(ask):
    ask(
        KIND, "a mistyped task", "run", "spot/mvoe_box", code=2, says="unknown task 'spot/mvoe_box'"
    )
