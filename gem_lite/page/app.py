"""The page itself, made with gradio. What it does is in `session`."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

os.environ.setdefault("GRADIO_ANALYTICS_ENABLED", "False")  # gradio reads it when it is imported

import gradio
import matplotlib

from gem_lite import tasks
from gem_lite.evaluation.evaluate import is_same_table
from gem_lite.page.session import LONGEST_SENTENCE, SPLIT, Session, Shown, check_size
from gem_lite.policies.gem import Gem

IDLE = 900
"""A session that nobody uses ends after so many seconds."""
MOST_VISITORS = 30
"""So many sessions may be open at once: each may hold a world."""
LARGEST_FILE = "10mb"
WAITING = 40
"""So many questions may wait; further visitors are asked to try again."""
FIRST_TASK = "put-block-in-bowl-seen-colors"
ABOUT = """# gem_lite: language-conditioned pick and place
Lay a table, say what to do, and look: the table from above, the semantic map of each phrase, the chosen pick and place.
Then let the simulator act. Maps are those of {clip}. Nothing that you type or upload is kept."""


def make_page(policy: Gem, names: Sequence[str]) -> gradio.Blocks:
    """The page for a policy.

    Args:
        policy: in evaluation mode; all visitors share it, one after the other.
        names: of tasks. A visitor may choose those whose table is the policy's. If there is none, only a visitor's own
            pictures are looked at.
    """
    offered = [name for name in names if is_same_table(tasks.make(name, SPLIT).workspace, policy.config.workspace)]
    matplotlib.use("Agg")
    plain = gradio.themes.Base(font=["sans-serif"], font_mono=["monospace"])  # no fonts from elsewhere
    page = gradio.Blocks(title="gem_lite", analytics_enabled=False, delete_cache=(60, IDLE))
    page.theme = plain
    first = FIRST_TASK if FIRST_TASK in offered else next(iter(offered), None)
    visitors: list[Session] = []
    turn = threading.Lock()  # gradio ends a session outside of its queue

    def end(session: Session | None) -> None:
        if session is not None:
            with turn:
                session.close()
            if session in visitors:
                visitors.remove(session)

    with page:
        gradio.Markdown(ABOUT.format(clip=policy.clip.name))
        session = gradio.State(value=None, time_to_live=IDLE, delete_callback=end)
        with gradio.Row():
            with gradio.Column(scale=1):
                with gradio.Tab("A simulated table", visible=bool(offered)):
                    task = gradio.Dropdown(offered, value=first, label="task")
                    episode = gradio.Number(value=0, precision=0, minimum=0, maximum=999_999, label="scene number")
                    lay = gradio.Button("lay the table", elem_id="lay")
                with gradio.Tab("Your pictures"):
                    gradio.Markdown("The files of a scene: `cameras.json` and its PNG pictures.")
                    files = gradio.File(file_count="multiple", file_types=[".json", ".png"], label="files")
                    upload = gradio.Button("look at them", elem_id="upload")
                sentence = gradio.Textbox(label="sentence", max_length=LONGEST_SENTENCE, elem_id="sentence")
                with gradio.Row():
                    ask = gradio.Button("ask", variant="primary", elem_id="ask")
                    act = gradio.Button("act", elem_id="act")
                    reset = gradio.Button("reset", elem_id="reset")
                text = gradio.Textbox(label="answer", interactive=False, lines=3, elem_id="answer")
            with gradio.Column(scale=2):
                picture = gradio.Image(
                    label="from above", show_label=False, interactive=False, format="png", buttons=["fullscreen"],
                    elem_id="picture",
                )  # fmt: skip

        def wire(button: gradio.Button, does: Callable[..., Shown], inputs: list) -> None:
            def run(known: Session | None, *values: object) -> tuple:
                if known is None and len(visitors) >= MOST_VISITORS:
                    return None, "Too many visitors: try again in some minutes.", gradio.skip()
                visitor = known or Session(policy)
                try:
                    with turn:
                        shown = does(visitor, *values)
                except ValueError as error:
                    if known is None:
                        end(visitor)  # Nobody else has it: its world would stay open.
                    return known, f"Not possible: {error}.", gradio.skip()
                if visitor not in visitors:
                    visitors.append(visitor)
                return visitor, shown.text, shown.picture

            outputs = [session, text, picture]
            button.click(
                run, [session, *inputs], outputs, concurrency_limit=1, concurrency_id="table", api_visibility="private"
            )

        wire(lay, lambda visitor, name, number: visitor.lay(str(name), int(number or 0)), [task, episode])
        wire(upload, lambda visitor, paths: visitor.upload(_taken(paths)), [files])
        wire(ask, lambda visitor, words: visitor.ask(str(words or "")), [sentence])
        wire(act, lambda visitor: visitor.act(), [])

        def begin_again(known: Session | None) -> tuple:
            end(known)
            return None, "", None, "", None

        reset.click(
            begin_again, [session], [session, text, picture, sentence, files], concurrency_limit=1,
            concurrency_id="table", api_visibility="private",
        )  # fmt: skip
    return page.queue(max_size=WAITING)


def serve(policy: Gem, host: str, port: int) -> None:
    """Show the page until Ctrl-C."""
    make_page(policy, tasks.names()).launch(
        server_name=host, server_port=port, share=False, max_file_size=LARGEST_FILE, footer_links=[], quiet=True,
        show_error=False,
    )  # fmt: skip


def _taken(paths: Sequence[str] | None) -> dict[str, bytes]:
    """The content of uploaded files by name. gradio's copies are deleted.

    Raises:
        ValueError: they were taken before, are too many or too large together, or two have the same name.
    """
    files = [Path(path) for path in paths or ()]
    if len({path.name for path in files}) < len(files):
        raise ValueError("two files have the same name")
    try:
        check_size(len(files), sum(path.stat().st_size for path in files))
        content = {path.name: path.read_bytes() for path in files}
    except FileNotFoundError:
        raise ValueError("these files were looked at and deleted: choose them again") from None
    for path in files:
        path.unlink(missing_ok=True)
    return content
