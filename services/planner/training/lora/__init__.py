"""The other candidate: SmolLM2-135M with a LoRA adapter, for servers that run GGUF files (Ollama, llama.cpp)."""
