"""The operator's page in a real browser, on a live run."""

import shutil
import threading
import time
from contextlib import contextmanager

import pytest

from sumo_dist.launch import serve
from sumo_dist.launch.launcher import Service
from sumo_dist.services import control
from sumo_dist.services.control import ControlOptions
from sumo_dist.services.tracer import EMBEDDED
from sumo_dist.wire.messages import Question
from sumo_dist.wire.session import nobody_listens

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(CHROMIUM is None, reason="no browser: apt install chromium"),
]

PATIENCE_MS = 90_000


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        flags = ["--no-sandbox", "--ignore-gpu-blocklist", "--enable-unsafe-swiftshader"]
        flags.append("--use-angle=gl-egl")
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield launched
        launched.close()


class Page:
    """A browser's tab with the page, which must not complain."""

    def __init__(self, browser, address, scene="off"):
        self.tab = browser.new_page(viewport={"width": 1400, "height": 900})
        self.tab.set_default_timeout(PATIENCE_MS)
        self.errors = []
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.add_init_script(f"if (window === top) localStorage.setItem('scene', '{scene}')")
        self.tab.goto(address)

    def text(self, selector):
        return self.tab.locator(selector).inner_text()

    def until(self, script):
        """Wait for a condition; asked from here, since the page's policy permits no eval."""
        deadline = time.monotonic() + PATIENCE_MS / 1e3
        while not self.tab.evaluate(script):
            assert time.monotonic() < deadline, script
            self.tab.wait_for_timeout(50)

    def mode(self, mode):
        self.until(f"document.querySelector('#mode').textContent === '{mode}'")

    def number(self, label):
        return float(self.tab.get_by_label(label, exact=True).input_value())

    def refused(self):
        """Why numbers that were set were refused."""
        sliders = "[...document.querySelectorAll('.slider.refused')]"
        return self.tab.evaluate(f"{sliders}.map((slider) => slider.title)")

    def set(self, label, value):
        field = self.tab.get_by_label(label, exact=True)
        field.fill(str(value))
        field.press("Enter")
        field.evaluate("element => element.blur()")


@contextmanager
def served(endpoint, port):
    """The control service of a run; a test may end it and start another one."""
    stop = threading.Event()
    options = ControlOptions(connect=endpoint, robot="spot", listen=f"127.0.0.1:{port}")
    thread = threading.Thread(target=control.run, args=(options, stop))
    thread.start()
    deadline = time.monotonic() + 60
    while nobody_listens(f"tcp/127.0.0.1:{port}"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    try:
        yield
    finally:
        stop.set()
        thread.join(30)
        assert not thread.is_alive()


def test_a_live_run_is_driven_from_the_browser(browser, run_system, free_endpoint):
    """Everything that an operator does, in one run; two tabs, a reload, and a service that goes.

    Robot time passes only where a plan is needed: however slow the browser is, no episode ends
    while the page is worked.
    """
    system = run_system(workers=1, time_limit=3600.0, stay=True)
    assert system.command("pause").refusal == ""
    questions = system.bus.newest(Question)
    port = free_endpoint().rpartition(":")[2]
    with served(system.endpoint, port):
        first = Page(browser, f"http://127.0.0.1:{port}/")
        second = Page(browser, f"http://127.0.0.1:{port}/")
        first.mode("paused")
        hold_and_release(first, second)
        rest(first)
        steer_numbers(first, second, questions)
        drag_the_goal(first, questions)
        switch(first, second, system)
        first.tab.reload()
        first.until("document.querySelector('#task').textContent === 'spot/move_tire'")
        lose_and_find_services(first, system)
    first.until("document.querySelector('#banner').textContent.startsWith('No line')")
    with served(system.endpoint, port):  # the page finds it again by itself
        first.until("!document.body.classList.contains('stale')")
        first.tab.keyboard.press("r")
        hold(system, first, episode=3)
        first.tab.keyboard.press("Escape")
        first.mode("ended")
        assert "stopped by" in first.text("#banner")
        set_between_episodes(first, system, questions)
    assert first.errors == second.errors == []


def hold(system, page, episode):
    """Pause an episode as soon as it has plans, and wait for the page to show it."""
    system.after_plan(1, episode)
    assert system.command("pause").refusal == ""
    page.mode("paused")
    page.until("document.querySelector('#banner').hidden")


def hold_and_release(page, other):
    """By a key; the other tab follows."""
    for mode in ("running", "paused"):
        page.tab.keyboard.press("p")
        page.mode(mode)
        other.mode(mode)


def rest(page):
    """Of a paused run nothing is written, though pictures come: it would all be drawn anew."""
    count = """seconds => new Promise((resolve) => {
        let writes = 0;
        const watch = { subtree: true, childList: true, attributes: true, characterData: true };
        new MutationObserver((all) => { writes += all.length; }).observe(document.body, watch);
        setTimeout(() => resolve(writes), 1000 * seconds);
    })"""
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while writes := page.tab.evaluate(count, 1):  # rates run out
        assert time.monotonic() < deadline, f"{writes} writes a second"


def step(page):
    """Half a second, in which plans are made."""
    page.tab.locator("#step").click(modifiers=["Shift"])


def step_until(page, script):
    """Step until a condition holds: a step may end before what was set has come to the robot."""
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while not page.tab.evaluate(script):
        assert time.monotonic() < deadline, (script, page.text("#gauges"), page.refused())
        step(page)
        page.tab.wait_for_timeout(2000)


def steer_numbers(page, other, questions):
    """Change a weight by its slider, step: the cost and the other tab follow."""
    before = page.text("#costs .bar:first-child b")
    weight = page.number("goal")
    slider = page.tab.get_by_label("goal, slider")
    slider.focus()
    slider.press("End")
    highest = page.number("goal")
    assert highest > weight
    time.sleep(0.5)
    assert page.number("goal") == highest  # though no plan has it yet
    step(page)
    other.until(f"document.querySelector('[aria-label=goal]').value === '{highest:g}'")
    assert questions.peek().weights.max() >= highest
    page.until(f"document.querySelector('#costs .bar b').textContent !== '{before}'")
    page.set("rollouts", 6)
    step_until(page, "document.querySelector('#gauges').textContent.includes('rollouts6')")


def drag_the_goal(page, questions):
    """It is where one double-clicks, and the robot plans for where it is dropped."""
    box = page.tab.locator("#floor canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.tab.mouse.dblclick(x, y)
    page.until("document.querySelector('[aria-label=\"goal x\"]').value !== '0'")
    put = page.number("goal x"), page.number("goal y")
    page.tab.mouse.move(x, y)
    page.tab.mouse.down()
    page.tab.mouse.move(x + 60, y - 45, steps=5)
    page.tab.mouse.up()
    time.sleep(0.5)
    wanted = page.number("goal x"), page.number("goal y")
    assert wanted[0] > put[0] + 0.05
    assert wanted[1] > put[1] + 0.05
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while abs(questions.peek().parameters[0] - wanted[0]) > 1e-3:
        assert time.monotonic() < deadline
        step(page)
        page.tab.wait_for_timeout(2000)
    assert questions.peek().parameters[1] == pytest.approx(wanted[1], abs=1e-3)


def switch(page, other, system):
    """Another optimizer, and another task with the seed that stands there."""
    page.tab.get_by_label("optimizer").select_option("mppi")
    page.set("seed", 7)
    page.tab.locator("#tasks").select_option("spot/move_tire")
    hold(system, page, episode=2)
    for tab in (page, other):
        tab.until("document.querySelector('#task').textContent === 'spot/move_tire'")
        tab.until("document.querySelector('[aria-label=optimizer]').value === 'mppi'")
    assert other.number("seed") == 7


def lose_and_find_services(page, system):
    """What is gone is told, and that it is back."""
    system.kill("optimizer")
    page.until("document.querySelector('#banner').textContent.includes('Gone: optimizer')")
    system.start_again("optimizer")
    page.until("!document.querySelector('#banner').textContent.includes('Gone')")
    page.tab.locator("td button").click()
    page.until("document.querySelector('#banner').textContent.startsWith('No worker')")
    system.start_again("local-0")
    page.until("document.querySelector('#banner').hidden")
    step_until(page, "/local-0.*answers/s.test(document.querySelector('#fleet table').textContent)")


def set_between_episodes(page, system, questions):
    """What is set while none goes on is shown and is the next one's; what is refused is not."""
    page.tab.get_by_label("optimizer").select_option("cem")
    page.set("rollouts", 7)
    page.tab.wait_for_timeout(500)
    assert page.tab.get_by_label("optimizer").input_value() == "cem"
    assert page.number("rollouts") == 7
    page.tab.keyboard.press("n")
    hold(system, page, episode=4)
    settings = questions.peek().settings
    assert (settings["optimizer"], settings["rollouts"]) == ("cem", 7)


def test_reruns_view_is_within_the_page(browser, run_system, free_endpoint, tmp_path):
    """Its page and its data come under the page's own address."""
    system = run_system(workers=1, time_limit=3600.0)
    assert system.command("pause").refusal == ""  # a tracer ends with the run
    tracer = serve.Tracer(
        connect=system.endpoint, robot="spot", viewer=EMBEDDED, out=tmp_path / "view"
    )
    system.start(Service("tracer", "tracer", tracer, vital=False))
    port = free_endpoint().rpartition(":")[2]
    with served(system.endpoint, port):
        page = Page(browser, f"http://127.0.0.1:{port}/")
        asked = []
        page.tab.on("response", lambda answer: asked.append((answer.url, answer.status)))
        page.tab.locator("#scene").check()
        page.tab.frame_locator("iframe").locator("canvas").wait_for()
        deadline = time.monotonic() + PATIENCE_MS / 1e3
        while not any("/rerun." in url and status == 200 for url, status in asked):
            assert time.monotonic() < deadline, asked
            page.tab.wait_for_timeout(100)
        assert all(
            f"//127.0.0.1:{port}/" in url or f"//localhost:{port}/" in url for url, _ in asked
        )
        system.kill("tracer")
        asked.clear()
        system.start_again("tracer")  # Rerun does not find its data again: its page is loaded anew
        while not any("/view/?url=" in url and status == 200 for url, status in asked):
            assert time.monotonic() < deadline + PATIENCE_MS / 1e3, asked
            page.tab.wait_for_timeout(100)
        page.tab.locator("#scene").uncheck()  # it costs a slow browser most of its time
        page.tab.wait_for_selector("iframe", state="hidden")
        system.kill("tracer")
        page.tab.locator("#scene").check()
        page.until("document.querySelector('#view .note').textContent.startsWith('No tracer')")
    assert page.errors == []
