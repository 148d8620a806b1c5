"""The part of a manifest that says in which form a policy sees the images of a robot's three cameras."""

from pydantic import Field, model_validator

from api_schemas.schema import Schema

VIEWS, CAMERA_PX, CHANNELS = 3, 270, 3
"""Cameras of a robot, the edge of their images, and red, green, blue."""
IMAGE_PX = (270, 135, 90, 54, 45, 30)
"""Edges of the images that a policy may ask for: each pixel is the mean of a whole number of the camera's."""
IMAGES = "images"
"""The graph's input where robots run it, whatever it was called when it was uploaded."""


class PolicyImages(Schema):
    """Images that a policy sees beside its observation: the three views of the newest frame that has arrived.

    ``input`` is the input of its ONNX graph that takes them, uint8, of exactly ``shape``: cameras at 60, 180 and 300 degrees,
    rows from the top, columns, red first. They are as late as the tracker's poses, and ``tracker_delay_s`` says how late.
    """

    input: str = Field(default=IMAGES, min_length=1, max_length=100)
    shape: tuple[int, int, int, int] = (VIEWS, CAMERA_PX, CAMERA_PX, CHANNELS)

    @model_validator(mode="after")
    def _shape_is_known(self) -> "PolicyImages":
        if self.shape not in {(VIEWS, edge, edge, CHANNELS) for edge in IMAGE_PX}:
            edges = ", ".join(map(str, IMAGE_PX))
            raise ValueError(f"images of shape {list(self.shape)} are not given; choose [3, n, n, 3] with n of {edges}")
        return self

    @property
    def edge_px(self) -> int:
        """Width and height of each view."""
        return self.shape[1]

    @property
    def size(self) -> int:
        """Bytes of all three views."""
        return VIEWS * self.edge_px**2 * CHANNELS
