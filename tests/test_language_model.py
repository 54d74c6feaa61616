"""Language models: scores against reading every text, what cannot be had, and servers on the loopback address."""

import contextlib
import http.server
import json
import threading
import time

import pytest
import torch

from gem_lite.language import Queries, Question, models, parse, understand
from gem_lite.language.asking import AskingParser, pick_and_place, spoken
from gem_lite.language.models import ModelError, Server

PROMPT = "Request: Put the red mug in the sink.\nThing:"
TEXTS = [" red mug", " sink", " red", " nothing at all"]
SENTENCE = "the yellow block goes in the green bowl"  # The grammar refuses it.


@pytest.fixture(scope="module")
def small_model():
    return models.load()


def read_whole(model, prompt, text):
    """The log-probability of a text after a prompt, from one pass over both."""
    start, end = (model.tokenizer(part)["input_ids"] for part in (prompt, text))
    with torch.inference_mode():
        logits = model.model(torch.tensor([start + end])).logits[0].log_softmax(dim=-1)
    return sum(float(logits[len(start) + number - 1, token]) for number, token in enumerate(end))


def test_scores_are_those_of_reading_every_text_by_itself(small_model):
    for prompt in (PROMPT, "Examples of toys: a", PROMPT.replace("red", "blue"), PROMPT):  # The cache is cut and used.
        found = small_model.scores(prompt, TEXTS)
        assert found == pytest.approx([read_whole(small_model, prompt, text) for text in TEXTS], abs=2e-3)
    assert small_model.scores(PROMPT, TEXTS[:1]) == pytest.approx(found[:1], abs=2e-3)
    assert small_model.scores(PROMPT, []).shape == (0,)


def test_many_texts_are_scored_in_several_passes(small_model, monkeypatch):
    together = small_model.scores(PROMPT, TEXTS)
    monkeypatch.setattr(models, "CHUNK", 3)
    assert small_model.scores(PROMPT, TEXTS) == pytest.approx(together, abs=2e-3)
    assert models._chunks([[1, 2], [3], [4, 5, 6, 7], [8]]) == [[0, 1], [2], [3]]


def test_a_model_that_was_interrupted_scores_as_before(small_model, monkeypatch):
    before = small_model.scores(PROMPT, TEXTS)
    for method in ("_forget", "_score"):

        def interrupt(*arguments):
            raise KeyboardInterrupt

        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(small_model, method, interrupt)
            small_model.scores(PROMPT.replace("red", "blue"), TEXTS)
        assert small_model.scores(PROMPT, TEXTS) == pytest.approx(before, abs=2e-3)


def test_empty_and_too_long_texts_are_refused_and_the_model_answers(small_model):
    for prompt, texts in (("", [" mug"]), (PROMPT, [" mug", ""])):
        with pytest.raises(ValueError, match="empty"):
            small_model.scores(prompt, texts)
    with pytest.raises(ValueError, match=r"tokens; smollm2 reads 8192"):
        small_model.scores("mug " * 9000, [" mug"])
    assert "Paris" in small_model.answer("What is the capital of France?")


def test_weights_that_cannot_be_had_are_told_in_one_sentence(monkeypatch, tmp_path):
    monkeypatch.setenv("GEM_LITE_CACHE", str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(models.importlib.util, "find_spec", lambda name: None)
        with pytest.raises(ModelError, match="not installed; install it with: pip install gguf"):
            models.load()
    with monkeypatch.context() as patch:
        patch.setattr(models, "SMALL_SUM", "0" * 64)
        with pytest.raises(ModelError, match="missing or damaged"):
            models.load()
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ModelError, match="could not be loaded"):
        models.load(str(tmp_path))


def test_converted_weights_that_changed_are_noticed(tmp_path):
    weights = tmp_path / "model.safetensors"
    weights.write_bytes(b"weights")
    assert not models._intact(tmp_path)
    (tmp_path / models.WEIGHTS_SUM).write_text(models._sum(weights))
    assert models._intact(tmp_path)
    weights.write_bytes(b"weight")
    assert not models._intact(tmp_path)


@contextlib.contextmanager
def served(answer, secrets=None):
    """A server of OpenAI's protocol on the loopback address; ``answer`` gets a message and returns a status, a body.

    ``secrets`` gets the secret of each request.
    """

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            if secrets is not None:
                secrets.append(self.headers["Authorization"])
            asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            status, body = answer(asked["messages"][-1]["content"])
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.end_headers()
            with contextlib.suppress(OSError):  # A client that waits no longer has gone.
                self.wfile.write(body)

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield Server(f"http://127.0.0.1:{server.server_address[1]}/v1", timeout=5)
    finally:
        server.shutdown()
        server.server_close()


def completion(text):
    choice = {"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": text}}
    whole = {"id": "1", "object": "chat.completion", "created": 0, "model": "m", "choices": [choice]}
    return 200, json.dumps(whole).encode()


def test_a_server_with_the_small_model_answers_over_the_loopback_address(small_model):
    with served(lambda message: completion(small_model.answer(message))) as server:
        assert server.answer("What is the capital of France?") == small_model.answer("What is the capital of France?")
        understood = understand(SENTENCE, AskingParser(server))
    words = set(SENTENCE.split())
    assert isinstance(understood, Question) or set(f"{understood[0].pick} {understood[0].place}".split()) <= words


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (lambda message: (500, b"{}"), "refused with status 500"),
        (lambda message: (200, b"<html>"), "does not speak OpenAI's chat protocol"),
        (lambda message: (200, b"{}"), "does not speak OpenAI's chat protocol"),
        (lambda message: completion(None), "answered without a text"),
        (lambda message: time.sleep(1.5) or completion("late"), r"no answer within 0.3 s"),
    ],
    ids=["error", "html", "other JSON", "no text", "slow"],
)
def test_a_server_that_fails_is_told_and_the_grammar_carries_on(answer, told):
    with served(answer) as working:
        server = Server(working.url, timeout=0.3 if "within" in told else 5)
        with pytest.raises(ModelError, match=told):
            server.answer("hello")
        parser = AskingParser(server)
        assert parser("put the red block in the green bowl") == Queries("red block", "green bowl")
        question = understand(SENTENCE, parser)
    assert isinstance(question, Question) and "goes" in question.text


def test_a_timeout_must_be_above_zero():
    with pytest.raises(ValueError, match=r"timeout must be above 0 s, got -1"):
        Server("http://127.0.0.1:1/v1", timeout=-1)


def test_a_server_gets_the_secret_of_the_environment_and_nothing_shows_it(monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "a secret")
    got = []
    with served(lambda message: completion("yes"), got) as server:
        assert server.answer("hello") == "yes"
    assert got == ["Bearer a secret"] and "secret" not in repr(server)


def test_a_server_that_is_down_is_told():
    with served(lambda message: completion("")) as gone:
        pass
    with pytest.raises(ModelError, match="cannot be reached"):
        gone.answer("hello")


class Answers:
    """A model that answers one text."""

    def __init__(self, text):
        self.text = text

    def answer(self, prompt):
        return self.text


@pytest.mark.parametrize(
    "text",
    [
        "", "I cannot do that.", "{", '{"pick": null, "place": null}', '{"pick": "yellow block"}', '["yellow block"]',
        '{"pick": "red block", "place": "green bowl"}', '{"pick": "yellow bowl", "place": "green bowl"}',
        '{"pick": "green bowl", "place": "green bowl"}', '{"pick": 3, "place": "green bowl"}',
        '{"pick": "rm -rf /", "place": "green bowl"}', '{"pick": "lock goes", "place": "green bowl"}',
    ],
)  # fmt: skip
def test_an_answer_that_is_not_of_the_sentences_words_is_asked_about(text):
    assert isinstance(understand(SENTENCE, AskingParser(Answers(text))), Question)


def test_an_answer_of_the_sentences_words_is_believed():
    text = 'Sure!\n{"pick": "the Yellow block", "place": "green bowl"}\nAnything else?'
    assert understand(SENTENCE, AskingParser(Answers(text))) == (Queries("yellow block", "green bowl"),)
    beside = AskingParser(Answers('{"pick": "fork", "place": "mug"}'))
    assert understand("I would like the fork left of the mug", beside) == (Queries("fork", "left of mug"),)
    for text, place, problem in (
        ("I want the fork in the box, not beside the box", "box", "more than one place"),
        ("I would like the fork between the mug and the bowl", "mug", "between"),
    ):
        question = understand(text, AskingParser(Answers(f'{{"pick": "fork", "place": "{place}"}}')))
        assert isinstance(question, Question) and problem in question.text
    assert understand("İİİ I would like the fork left of the mug", beside) == (Queries("fork", "left of mug"),)
    pushing = AskingParser(Answers('{"pick": "pile of red blocks", "place": "green square"}'))
    (queries,) = understand("You should now push the pile of red blocks into the green square", pushing)
    assert queries == Queries("pile of red blocks", "green square", push=True)
    assert pick_and_place("no JSON") == (None, None)
    assert spoken("", SENTENCE) is None and spoken("the", SENTENCE) is None


def test_a_question_or_queries_are_values():
    assert understand("put the red block in the green bowl", parse) == (Queries("red block", "green bowl"),)
    assert "empty" in understand(" ", parse).text
