"""What a manifest says of a network beyond its layers: stacked observations, memory, and how its outputs become actions."""

import math
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, model_validator

from api_schemas.schema import Schema

MOST_STACKED = 16
MOST_BINS = 101
MOST_STATE_NUMBERS = 65_536
Count = Annotated[int, Field(ge=1, le=MOST_STATE_NUMBERS)]


class Cell(StrEnum):
    """Kinds of recurrent layers, as torch's ``nn.LSTM`` and ``nn.GRU`` compute them."""

    LSTM = "lstm"
    GRU = "gru"


class ActionHead(StrEnum):
    """What the network's outputs stand for."""

    DIRECT = "direct"  # nine numbers, one a joint
    GAUSSIAN = "gaussian"  # nine means, then nine deviations; the means are taken
    BINS = "bins"  # nine times the preferences of the bins of one joint; the centre of the most preferred is taken


class FrameStack(Schema):
    """The network sees the ``count`` last observations one after the other, not only the present one.

    ``fill`` says what stands for those before the first: copies of the first, or zeros. Input scaling with one number per
    element of an observation comes before stacking (zeros are then zeros of the scaled observation); with one per element of
    the stack, after it.
    """

    count: int = Field(ge=2, le=MOST_STACKED)
    fill: Literal["first", "zeros"] = "first"
    order: Literal["oldest_first", "newest_first"] = "oldest_first"


class NetworkState(Schema):
    """One state of a recurrent ONNX graph: the input that takes it, the output that gives the next, its shape.

    A trial begins with zeros.
    """

    input: str = Field(min_length=1, max_length=200)
    output: str = Field(min_length=1, max_length=200)
    shape: tuple[Count, ...] = Field(max_length=4)

    @model_validator(mode="after")
    def _small_enough(self) -> "NetworkState":
        if math.prod(self.shape) > MOST_STATE_NUMBERS:
            raise ValueError(f"a state may hold {MOST_STATE_NUMBERS} numbers, not {math.prod(self.shape)}")
        return self
