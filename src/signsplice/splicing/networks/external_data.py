"""ONNX graphs that name other files for their weights: those files are in no bundle's hash."""

from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto

_FIELDS = {
    "Model": {7: "Graph", 20: "Training", 25: "Function"},
    "Training": {1: "Graph", 2: "Graph"},
    "Function": {7: "Node", 11: "Attribute"},
    "Graph": {1: "Node", 5: "Tensor", 15: "SparseTensor"},
    "Node": {5: "Attribute"},
    "Attribute": {5: "Tensor", 6: "Graph", 10: "Tensor", 11: "Graph", 22: "SparseTensor", 23: "SparseTensor"},
    "SparseTensor": {1: "Tensor", 2: "Tensor"},
    "Tensor": {13: "Entry", 14: ""},
    "Entry": {},
}
"""Message of ONNX -> field number -> message in that field; "" for a number. Only what leads to a tensor's
``external_data`` (13) and ``data_location`` (14); from onnx.proto3, https://github.com/onnx/onnx.
"""
_EXTERNAL = 1
"""``data_location`` of a tensor that lies in another file."""


def names_other_files(graph: bytes) -> bool:
    """Whether a tensor of an ONNX file lies in another file, in whatever graph, node or function of it.

    Raises ``google.protobuf.message.DecodeError`` where the bytes are no such file.
    """
    model = _model_class()()
    model.ParseFromString(graph)
    return _has_external_tensor(model)


def _has_external_tensor(message: Any) -> bool:
    for field, values in message.ListFields():
        if field.message_type is None:
            if _EXTERNAL in values:
                return True
        elif field.message_type.name == "Entry" or any(map(_has_external_tensor, values)):
            return True
    return False


def _model_class() -> Any:
    """The class of ONNX's ModelProto, with the fields of ``_FIELDS`` alone; protobuf passes over the others."""
    file = descriptor_pb2.FileDescriptorProto(name="onnx_tensors.proto", package="tensors")
    for name, fields in _FIELDS.items():
        message = file.message_type.add(name=name)
        for number, kind in fields.items():
            holds = {"type": FieldDescriptorProto.TYPE_INT32}
            if kind:
                holds = {"type": FieldDescriptorProto.TYPE_MESSAGE, "type_name": f".tensors.{kind}"}
            label = FieldDescriptorProto.LABEL_REPEATED
            message.field.add(name=f"field_{number}", number=number, label=label, **holds)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("tensors.Model"))
