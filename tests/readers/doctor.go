// Reads an MCAP file with the Go library and says what is wrong with it, as JSON: what "mcap doctor" looks at, and the scene.
package main

import (
	"bytes"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"os"

	"github.com/foxglove/mcap/go/mcap"
)

type found struct {
	Messages      uint64            `json:"messages"`
	PerTopic      map[string]uint64 `json:"per_topic"`
	SceneEntities int               `json:"scene_entities"`
	Attachments   int               `json:"attachments"`
	Metadata      int               `json:"metadata"`
	Chunks        int               `json:"chunks"`
	Problems      []string          `json:"problems"`
}

// The entities of an encoded foxglove.SceneUpdate: its fields of number 2, which are of length-delimited type.
func entities(message []byte) (int, error) {
	count := 0
	for at := 0; at < len(message); {
		key, size := varint(message[at:])
		length, more := varint(message[at+size:])
		if size == 0 || more == 0 || key&7 != 2 || at+size+more+int(length) > len(message) {
			return 0, errors.New("the scene is no message of length-delimited fields")
		}
		if key>>3 == 2 {
			count++
		}
		at += size + more + int(length)
	}
	return count, nil
}

func varint(data []byte) (uint64, int) {
	var value uint64
	for at, each := range data {
		if at == 10 {
			break
		}
		value |= uint64(each&0x7f) << (7 * at)
		if each < 0x80 {
			return value, at + 1
		}
	}
	return 0, 0
}

func look(data []byte) (out found) {
	out.PerTopic, out.Problems = map[string]uint64{}, []string{}
	wrong := func(format string, values ...any) { out.Problems = append(out.Problems, fmt.Sprintf(format, values...)) }
	attachment := func(reader *mcap.AttachmentReader) error {
		out.Attachments++
		_, err := io.Copy(io.Discard, reader.Data())
		return err
	}
	lexer, err := mcap.NewLexer(bytes.NewReader(data), &mcap.LexerOptions{
		ValidateChunkCRCs: true, ComputeAttachmentCRCs: true, AttachmentCallback: attachment,
	})
	if err != nil {
		wrong("not opened: %v", err)
		return
	}
	defer lexer.Close()
	schemas, channels, last := map[uint16]*mcap.Schema{}, map[uint16]*mcap.Channel{}, map[uint16]uint64{}
	var statistics *mcap.Statistics
	for {
		token, record, err := lexer.Next(nil)
		if errors.Is(err, io.EOF) {
			break
		}
		if err != nil {
			wrong("record not read: %v", err)
			return
		}
		switch token {
		case mcap.TokenSchema:
			schema, err := mcap.ParseSchema(record)
			if err != nil {
				wrong("schema: %v", err)
				continue
			}
			schemas[schema.ID] = schema
		case mcap.TokenChannel:
			channel, err := mcap.ParseChannel(record)
			if err != nil {
				wrong("channel: %v", err)
				continue
			}
			if schemas[channel.SchemaID] == nil && channel.SchemaID != 0 {
				wrong("channel %s has no schema", channel.Topic)
			}
			channels[channel.ID] = channel
		case mcap.TokenMessage:
			message, err := mcap.ParseMessage(record)
			if err != nil {
				wrong("message: %v", err)
				continue
			}
			channel := channels[message.ChannelID]
			if channel == nil {
				wrong("a message of channel %d, which there is not", message.ChannelID)
				continue
			}
			if message.LogTime < last[channel.ID] {
				wrong("%s goes back in time at %d ns", channel.Topic, message.LogTime)
			}
			last[channel.ID] = message.LogTime
			out.Messages++
			out.PerTopic[channel.Topic]++
			if schemas[channel.SchemaID].Name == "foxglove.SceneUpdate" {
				count, err := entities(message.Data)
				if err != nil {
					wrong("%s: %v", channel.Topic, err)
				}
				out.SceneEntities += count
			}
		case mcap.TokenMetadata:
			out.Metadata++
		case mcap.TokenStatistics:
			if statistics, err = mcap.ParseStatistics(record); err != nil {
				wrong("statistics: %v", err)
			}
		}
	}
	reader, err := mcap.NewReader(bytes.NewReader(data))
	if err != nil {
		wrong("no reader: %v", err)
		return
	}
	defer reader.Close()
	info, err := reader.Info()
	if err != nil {
		wrong("no summary: %v", err)
		return
	}
	out.Chunks = len(info.ChunkIndexes)
	if statistics == nil || statistics.MessageCount != out.Messages {
		wrong("the statistics do not count %d messages", out.Messages)
	}
	return
}

func main() {
	data, err := os.ReadFile(os.Args[1])
	if err != nil {
		fmt.Fprintln(os.Stderr, err)
		os.Exit(2)
	}
	out := look(data)
	text, _ := json.MarshalIndent(out, "", " ")
	fmt.Println(string(text))
	if len(out.Problems) > 0 {
		os.Exit(1)
	}
}
